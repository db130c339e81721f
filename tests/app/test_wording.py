"""The page's words for messages of the command line."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from gsedit.app.wording import WORDS, on_page

ROOT = Path(__file__).parents[2]
SOURCES = [path for room in ("gsedit", "cli") for path in (ROOT / room).rglob("*.py")]


def text_of(node: ast.AST) -> str:
    """A string with a word in the place of each value that is put into it; "" for other nodes."""
    match node:
        case ast.Constant(value=str(text)):
            return text
        case ast.JoinedStr(values=parts):
            return "".join(text_of(part) or "chair" for part in parts)
    return ""


@pytest.fixture(scope="module")
def messages():
    """Every string of the code, without those of the table itself."""
    own = [path for path in SOURCES if path.name != "wording.py"]
    nodes = [node for path in own for node in ast.walk(ast.parse(path.read_text()))]
    return "\n".join(filter(None, map(text_of, nodes)))


@pytest.mark.parametrize(("pattern", "there"), WORDS, ids=[each[0].pattern for each in WORDS])
def test_each_pattern_is_of_a_message_that_there_is(messages, pattern, there):
    assert pattern.search(messages)


def test_options_become_clicks():
    said = "no object is clear; mark it with --region, or say --phrase 'the bear'"
    assert (
        on_page(said) == "no object is clear; select it by a click, or select 'the bear' by words"
    )
