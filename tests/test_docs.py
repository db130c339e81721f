"""The README and docs/: their commands and options exist, and what they point to is there."""

from __future__ import annotations

import re
import shlex
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import typer
from command_line import program

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
TEXT = {str(page.relative_to(ROOT)): page.read_text() for page in PAGES}
BLOCK = re.compile(r"^```\w*\n(.*?)^```", re.MULTILINE | re.DOTALL)


def commands(text: str) -> list[str]:
    """Command lines of a page: those that begin a line of code, and those in backquotes."""
    lines = re.findall(r"^gsedit [a-z].*", "\n".join(BLOCK.findall(text)), re.MULTILINE)
    return lines + re.findall(r"`(gsedit [a-z][^`]*)`", BLOCK.sub("", text))


@cache
def verb(name: str) -> Any:
    """The command of `gsedit NAME`, or None."""
    group = program()
    found = group.get_command(typer.Context(group), name)
    return found and found.make_context(name, [], resilient_parsing=True).command


def options(command: Any, words: list[str]) -> set[str]:
    """Long options of a command, and of the one below it that the words name."""
    below = getattr(command, "commands", {})
    if words and words[0] in below:
        command = below[words[0]]
    params = command.get_params(typer.Context(command))
    names = {name for param in params for name in (*param.opts, *param.secondary_opts)}
    return {name for name in names if "--set." not in name and "--no-set." not in name}


@pytest.mark.parametrize("page", [page for page, text in TEXT.items() if commands(text)])
def test_commands_of_a_page_have_verbs_and_options_that_exist(page):
    for line in commands(TEXT[page]):
        words = shlex.split(line, comments=True)[1:]
        while words:
            end = words.index("then") if "then" in words else len(words)
            known = {*options(verb(words[0]), words[1:end]), "--help"} if verb(words[0]) else None
            assert known is not None, f"{line}: gsedit has no {words[0]}"
            used = {w.split("=")[0] for w in words[1:end] if re.match(r"--[a-z]", w)}
            if end < len(words) or "then" in line:
                known |= {"--output"}  # of the chain
            assert used <= known, f"{line}: {words[0]} has no {', '.join(sorted(used - known))}"
            words = words[end + 1 :]


@pytest.mark.parametrize("page", ["README.md", "CONTRIBUTING.md"])
def test_links_of_a_page_outside_the_site_lead_somewhere(page):
    """mkdocs checks those of the site."""
    for target in re.findall(r"\]\(([^)#]+)", TEXT[page]):
        assert (ROOT / target).exists(), target


@pytest.mark.parametrize("page", list(TEXT))
def test_files_and_experiments_that_a_page_names_exist(page):
    folders = "cli|docs|examples|gsedit|rasterizer|tests"
    for path in re.findall(rf"`((?:{folders})/[\w/.-]*)`", TEXT[page]):
        assert (ROOT / path).exists(), path
    for module in re.findall(r"python\s+-m\s+(research[\w.]+)", TEXT[page]):
        path = ROOT / "examples" / module.rstrip(".").replace(".", "/")
        assert path.with_suffix(".py").is_file() or (path / "__main__.py").is_file(), module


def test_paths_of_docs_in_the_code_exist():
    for folder in ("cli", "gsedit", "rasterizer", "examples", "tests"):
        for file in (ROOT / folder).rglob("*.py"):
            for path in re.findall(r"\bdocs/[\w/]+\.md", file.read_text()):
                assert (ROOT / path).exists(), f"{file}: {path}"


def test_every_place_of_the_architecture_exists():
    named = re.findall(r"`((?:gsedit|cli|tests)/[^`]+)`", TEXT["docs/concepts/architecture.md"])
    assert len(named) > 20
    assert [each for each in named if not (ROOT / each).exists()] == []
