"""A settings record is its own command line: each field an option, nothing said twice."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import pytest
import typer
from gsedit_cli.core.command import LazyCommand, VerbCommand, as_command, lazy_verb
from gsedit_cli.options.settings import (
    Layout,
    SettingsGroup,
    settings_of,
    with_values,
)
from typer.testing import CliRunner

from gsedit.errors import UsageError

Mode = Literal["soft", "hard-edged"]


@dataclass(frozen=True)
class Inner:
    steps: int = 7
    """Steps of the inner part."""
    share: float | None = None
    """Share of it, in [0, 1]. None: all that is left."""


@dataclass(frozen=True)
class Outer:
    """A throw-away record with a field of every kind that an option can hold."""

    steps: int = 20
    """Steps of `everything`,
    on two lines."""
    mode: Mode = "soft"
    """How sharp it is."""
    gentle: bool = True
    fast: bool = False
    """Be quick about it."""
    views_per_batch: int = field(default=4, metadata={"flag": "--views"})
    """Views edited in turn."""
    file: Path | None = None
    """File to write to."""
    inner: Inner = field(default_factory=lambda: Inner(steps=9))
    """Settings of the inner part."""
    library_only: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        if self.steps < 1:
            raise ValueError("steps")


LAYOUT = Layout("Outer panel", panels={"inner": "Inner panel"}, without=("library_only",))
GIVEN: list[Mapping[tuple[str, ...], Any]] = []


def verb(
    name: str,
    settings: Annotated[
        Mapping[tuple[str, ...], Any], SettingsGroup(lambda: settings_of(Outer(), LAYOUT))
    ],
) -> None:
    """Do it to NAME.

    A second paragraph.
    """
    GIVEN.append(settings)


@pytest.fixture
def run(monkeypatch):
    """Runs the verb: its result, and the settings it was given."""
    monkeypatch.setenv("COLUMNS", "160")
    app = typer.Typer(rich_markup_mode=None)
    app.command(cls=VerbCommand)(as_command(verb))

    def run(*words: str) -> tuple[Any, Mapping[tuple[str, ...], Any]]:
        GIVEN.clear()
        result = CliRunner().invoke(app, list(words))
        return result, GIVEN[0] if GIVEN else {}

    return run


def test_every_field_is_an_option_with_help_and_default(run):
    text = " ".join(run("--help-all")[0].output.split())
    for words in (
        "Steps of everything, on two lines. [default: 20]",
        "--mode soft|hard-edged",
        "--gentle",
        "--views N Views edited in turn. [default: 4]",
        "--file PATH",
        "[default: all that is left]",
    ):
        assert words in text
    assert text.index("Outer panel") < text.index("--steps")
    assert text.index("Inner panel") < text.index("--inner-steps")
    assert "--no-fast" not in text
    assert "library" not in text


def test_set_gives_any_option_a_value(run):
    words = ["inner.steps=3", "mode=hard-edged", "gentle=off", "fast=on", "views=2", "share=0.5"]
    result, values = run("me", *(word for each in words for word in ("--set", each)))
    assert result.exit_code == 0, result.output
    same = "me --inner-steps 3 --mode hard-edged --no-gentle --fast --views 2 --share 0.5"
    assert values == run(*same.split())[1]
    assert run("me", "--set=views_per_batch=5")[1] == {("views_per_batch",): 5}
    assert run("me", "--set", "fast=off")[1] == {}


def test_only_what_is_given_replaces_the_records_values(run):
    result, values = run("me")
    assert result.exit_code == 0, result.output
    assert values == {}
    assert with_values(Outer(), values) == Outer()
    words = "me --mode hard-edged --no-gentle --views 2 --inner-steps 3 --share 0.5 --file a"
    _, values = run(*words.split())
    base = Outer(steps=5)
    assert with_values(base, values) == Outer(
        5, "hard-edged", False, False, 2, Path("a"), Inner(3, 0.5)
    )
    with pytest.raises(UsageError, match="steps"):  # the record checks itself
        with_values(base, {("steps",): 0})


def test_a_field_that_no_option_can_hold_is_an_error_with_its_name():
    with pytest.raises(TypeError, match=r"library_only: no option can hold a tuple\[int, \.\.\.\]"):
        settings_of(Outer(), Layout("Panel"))


def test_a_listed_verb_makes_its_options_when_it_is_asked_for(monkeypatch):
    command = lazy_verb(verb)
    assert isinstance(command, LazyCommand)
    assert (command.name, command.help) == ("verb", "Do it to NAME.")
    assert command.params == []
    with command.make_context("verb", ["me", "--steps", "3"]) as context:
        assert {param.name for param in context.command.params} >= {"name", "steps"}
