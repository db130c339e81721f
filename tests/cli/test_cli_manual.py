"""Manual pages say what --help-all says, and man has nothing to complain of."""

from __future__ import annotations

import re
import shutil
import subprocess

import pytest
from command_line import gsedit
from gsedit_cli.core.manual import escaped, manual_pages

FLAG = re.compile(r"(?<![\w-])--?[a-z][a-z0-9-]*(?![\w-])")
GROFF = shutil.which("groff") or ""


@pytest.fixture(scope="module")
def pages() -> dict[str, str]:
    return manual_pages("1.2.3")


def test_a_page_has_the_options_of_its_verb(pages):
    assert {"gsedit.1", "gsedit-edit.1", "gsedit-convert.1", "gsedit-bench-edit.1"} <= set(pages)
    for name, page in pages.items():
        verb = name.removesuffix(".1").split("-")[1:]
        told = gsedit(*verb, "--help-all" if verb and verb != ["bench"] else "--help").stdout
        told = re.sub(r"-\n +", "-", told)
        written = re.sub(r"\\fB|\\fP", " ", page).replace(r"\-", "-")
        assert set(FLAG.findall(written)) == set(FLAG.findall(told)), name


def rendered(text: str, *options: str) -> subprocess.CompletedProcess[str]:
    """Return what groff makes of pages."""
    if not GROFF:
        pytest.skip("groff is not installed")
    command = [GROFF, "-man", "-Tutf8", "-P-cbou", *options]
    return subprocess.run(command, input=text, capture_output=True, text=True, check=True)


def test_man_renders_every_page_without_a_warning(pages):
    done = rendered("".join(pages.values()), "-ww")
    assert not done.stderr
    for page in pages.values():
        for line in re.findall(r"^\.EX\n(.*)\n\.EE$", page, re.MULTILINE):
            assert re.sub(r"\\\(aq", "'", line.replace(r"\-", "-")) in done.stdout
    assert "gsedit 1.2.3" in done.stdout


@pytest.mark.parametrize("text", [".so /etc/passwd", "'a -- b\\n'", "~/a^b `c`", "8 °C, σ – x"])
def test_text_is_printed_as_it_is_written(text):
    assert rendered(f".TH A 1\n.SH B\n{escaped(text)}\n").stdout.count(text) == 1
