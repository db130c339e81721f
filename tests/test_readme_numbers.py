"""Each measured number of README.md stands in a results page that its paragraph or row links to.

A number that is in none was typed by hand, or is of a version that is gone.
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGES = ROOT / "docs" / "measurements"
ROWS = PAGES / "front-page.md"
"""The page of the README's own table."""
NAMES = ("two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")
WORDS = {name: value for value, name in enumerate(NAMES, 2)}
"""Numbers that prose writes in letters."""
SAME = (
    ("s", "second", "seconds"),
    ("min", "minute", "minutes"),
    ("px", "pixels"),
    ("%", "percent"),
)
UNITS = (
    "dB", "ms", "GB", "MB", "kB", "degrees", "million", "views", "photos", "Gaussians", "materials",
    "looks", "sentences", "hours", "that were kept", "were read right",
    *(unit for units in SAME for unit in units),
)  # fmt: skip
NUMBER = rf"\d[\d,]*(?:\.\d+)?|{'|'.join(WORDS)}"
WITH_UNIT = re.compile(
    rf"(?<![\w.,])({NUMBER})[ -]?({'|'.join(sorted(UNITS, key=len, reverse=True))})(?!\w)"
)
WITH_EXPONENT = re.compile(r"(?<![\w.,])(\d+(?:\.\d+)?e-?\d+)()")
LINK = re.compile(r"\]\(docs/measurements/([\w-]+\.md)")
EXEMPT = {
    "100 materials": "not measured: counted in the code, see below",
    "three minutes": "the name of a page",
}
"""Numbers that no results file holds, each with the reason."""


def blocks(text: str) -> list[str]:
    """Paragraphs, items of lists and rows of tables, without what is code or a picture."""
    text = re.sub(r"```.*?```|!\[.*?\]\(.*?\)", "", text, flags=re.DOTALL)
    return [each for each in re.split(r"\n\s*\n|\n(?=- |\|)", text) if each.strip()]


def numbers(block: str) -> list[tuple[str, str, str]]:
    """(as it is written, number, unit) of each measured quantity in a block."""
    prose = " ".join(re.sub(r"\]\([^)]*\)|`[^`]*`", "]", block).split())
    found = [*WITH_UNIT.finditer(prose), *WITH_EXPONENT.finditer(prose)]
    return [(each[0].strip(), each[1], each[2]) for each in found]


def stands(number: str, unit: str, text: str) -> bool:
    """Whether a results file has the number: with its unit, in a cell of a table, or, if it has
    decimals or four digits, anywhere."""
    forms = {number, *([str(WORDS[number])] if number in WORDS else [])}
    forms |= {word for word, value in WORDS.items() if str(value) == number}
    units = next((each for each in SAME if unit in each), (unit,))
    for form in map(re.escape, forms):
        alone = rf"(?<![\w.,]){form}(?![\w]|[.,]\d)"
        if re.search(rf"{alone}[ -]?({'|'.join(map(re.escape, units))})(?!\w)", text):
            return True
        if re.search(rf"[|,;:] *\**{form}\**(?![\w]|[.,]\d)[^|\n]*\|", text):
            return True
        if len(re.sub(r"\D", "", form)) > 2 and re.search(alone, text):
            return True
    return False


def results_of(block: str) -> str:
    """All results files that a block links to, ROWS for a row of a table, and the page that
    describes machines and scenes."""
    pages = [PAGES / name for name in LINK.findall(block)]
    own = [ROWS] if block.strip().startswith("|") else []
    tables = [each for page in pages for each in (PAGES / "data").glob(f"{page.stem}-*.csv")]
    return "\n".join(each.read_text() for each in (*pages, *tables, *own, PAGES / "index.md"))


def unproved(text: str) -> list[str]:
    """The numbers of a text that no results file of their block holds."""
    return [
        words
        for block in blocks(text)
        for words, number, unit in numbers(block)
        if words not in EXEMPT and not stands(number, unit, results_of(block))
    ]


def test_every_number_stands_in_the_page_that_it_links_to():
    text = (ROOT / "README.md").read_text()
    assert len([each for block in blocks(text) for each in numbers(block)]) > 20
    assert unproved(text) == []


def test_what_is_exempt_is_still_in_the_readme():
    prose = " ".join((ROOT / "README.md").read_text().split())
    assert [words for words in EXEMPT if words not in prose] == []


def test_materials_are_as_many_as_the_code_has():
    from gsedit.materials.table import MATERIALS

    assert f"{len(MATERIALS)} materials" in EXEMPT


@pytest.mark.parametrize(
    "claim",
    [
        "| fit | 25.9 dB in 90 s | ([page](docs/measurements/fitting.md)) |",
        "| fit | 25.2 dB in 91 s | ([page](docs/measurements/fitting.md)) |",
        "| fit | 25.2 dB in 90 s | no page |",
        "Rendered in 37 ms ([page](docs/measurements/renderer.md)).",
        "Of 105 kept aside, 96 were read right ([page](docs/measurements/instructions.md))",
    ],
)
def test_a_number_that_no_page_holds_is_found(claim):
    assert unproved(claim)
