"""A record is its own command line: each field an option, with a flag if its metadata says so."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import pytest
import typer
from command_line import gsedit, program
from gsedit_cli.core.command import (
    Settings,
    VerbCommand,
    as_command,
    parameters_of,
    settings_of,
    with_values,
)
from gsedit_cli.options.editors import edit_settings, resolve
from gsedit_cli.verbs.fit import Recipe
from typer.testing import CliRunner

from gsedit import EditSettings
from gsedit.errors import UsageError
from gsedit.paper import strategies
from gsedit.paper.settings import find_preset
from gsedit.paper.strategies.single_pass import SinglePass

Mode = Literal["soft", "hard-edged"]
FLAGS = {
    "--strategy", "--steps", "--loss", "--views", "--batches", "--geometry", "--condition",
    "--region", "--disable", "--kernel", "--brush",
}  # fmt: skip
"""Settings of an edit that have a flag of their own."""


@dataclass(frozen=True)
class Inner:
    steps: int = 7
    """Steps of the inner part."""
    share: float | None = None
    """Share of it, in [0, 1]. None: all that is left."""


@dataclass(frozen=True)
class Outer:
    """A throw-away record with a field of every kind that an option can hold."""

    steps: int = field(default=20, metadata={"flag": "--steps"})
    """Steps of `everything`,
    on two lines."""
    mode: Mode = field(default="soft", metadata={"flag": "--mode"})
    """How sharp it is."""
    gentle: bool = True
    fast: bool = field(default=False, metadata={"flag": "--fast"})
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


GIVEN: list[Mapping[tuple[str, ...], Any]] = []


def outer() -> Any:
    return settings_of(Outer(), without=("library_only",))


def verb(name: str, settings: Annotated[Mapping[tuple[str, ...], Any], Settings(outer)]) -> None:
    """Do it to NAME.

    A second paragraph.
    """
    GIVEN.append(settings)


@pytest.fixture
def run(monkeypatch):
    """Runs the verb: its result, and the settings it was given."""
    monkeypatch.setenv("COLUMNS", "160")
    app = typer.Typer(rich_markup_mode=None)
    app.command(cls=VerbCommand)(as_command(verb, parameters_of(verb), verb))

    def run(*words: str) -> tuple[Any, Mapping[tuple[str, ...], Any]]:
        GIVEN.clear()
        result = CliRunner().invoke(app, list(words))
        return result, GIVEN[0] if GIVEN else {}

    return run


def test_a_field_with_a_flag_is_an_option_with_help_and_default(run):
    text = " ".join(run("--help-all")[0].output.split())
    for words in (
        "Steps of everything, on two lines. [default: 20]",
        "--mode soft|hard-edged",
        "--views N Views edited in turn. [default: 4]",
    ):
        assert words in text
    for words in ("--no-fast", "library", "gentle", "--file", "inner", "--set."):
        assert words not in text


def test_set_gives_any_field_a_value_of_its_type(run):
    words = ["inner.steps=3", "mode=hard-edged", "gentle=off", "fast=on", "views=2", "share=0.5"]
    result, values = run("me", *(word for each in words for word in ("--set", each)))
    assert result.exit_code == 0, result.output
    assert values == {
        ("inner", "steps"): 3, ("mode",): "hard-edged", ("gentle",): False, ("fast",): True,
        ("views_per_batch",): 2, ("inner", "share"): 0.5,
    }  # fmt: skip
    assert run("me", "--set=views_per_batch=5")[1] == {("views_per_batch",): 5}
    assert run("me", "--set", "fast=off")[1] == {}
    for wrong in ("inner.steps=many", "inner.step=3", "gentle=perhaps", "mode=odd", "share"):
        assert run("me", "--set", wrong)[0].exit_code == 2
    assert run("me", "--inner-steps", "3")[0].exit_code == 2


def test_only_what_is_given_replaces_the_records_values(run):
    assert run("me")[1] == {}
    assert with_values(Outer(), {}) == Outer()
    _, values = run("me", "--views", "2", "--set", "inner.steps=3", "--set", "file=a")
    expected = Outer(5, views_per_batch=2, file=Path("a"), inner=Inner(3))
    assert with_values(Outer(steps=5), values) == expected
    with pytest.raises(UsageError, match="steps"):  # the record checks itself
        with_values(Outer(), {("steps",): 0})
    with pytest.raises(TypeError, match=r"library_only: no option can hold a tuple\[int, \.\.\.\]"):
        list(settings_of(Outer()))


def settings_of_edit() -> dict[str, dict[str, str]]:
    """The settings that `gsedit list` names, by name."""
    done = gsedit("list", "settings", "edit", "--json")
    assert done.exit_code == 0, done.stderr
    return {each["name"]: each for each in map(json.loads, done.stdout.splitlines())}


@pytest.fixture
def add_strategy(monkeypatch, tmp_path):
    """Adds a strategy in a file of its own, with the given fields; returns its dataclass."""
    monkeypatch.setattr(strategies, "__path__", [*strategies.__path__, str(tmp_path)])
    added = []

    def add(name: str, summary: str, *fields: str) -> type:
        module = name.replace("-", "_")
        added.append(module)
        (tmp_path / f"{module}.py").write_text(
            "from dataclasses import dataclass\n"
            "@dataclass(frozen=True)\n"
            f"class {name.title().replace('-', '')}:\n"
            f'    """{summary}"""\n'
            + "".join(f"    {field}\n" for field in fields)
            + "    def schedule(self, session): return iter(())\n"
        )
        program.cache_clear()  # it has another choice now
        return strategies.find_strategy(name)

    yield add
    program.cache_clear()
    for module in added:
        sys.modules.pop(f"{strategies.__name__}.{module}", None)
        delattr(strategies, module)


def test_settings_of_an_edit_are_listed_and_few_have_a_flag():
    listed = settings_of_edit()
    assert {each["flag"] for each in listed.values() if each["flag"]} == FLAGS
    assert listed["sampler.guidance_every"]["default"] == "1"
    assert all(each["meaning"] for each in listed.values())
    for verb in ("fit", "render", "capture", "clean", "transform", "metrics"):
        assert len(gsedit("list", "settings", verb).stdout.splitlines()) >= 2


def test_what_is_not_given_is_the_librarys_choice():
    assert resolve("default", {}) == (EditSettings(), SinglePass())
    assert resolve("paper", {})[0] == find_preset("paper").settings
    other = strategies.find_strategy("iterative")()
    assert resolve("paper", {("strategy",): "iterative"})[1] == other
    given = {("sampler", "steps"): 7, ("strategy", "update_steps"): 9, ("views_per_batch",): 2}
    some, strategy = resolve("paper", given)
    assert (some.sampler.steps, some.sampler.target, some.views_per_batch) == (7, "xt", 2)
    assert strategy == SinglePass(update_steps=9)
    with pytest.raises(UsageError, match="preset"):
        resolve("newspaper", {})
    with pytest.raises(UsageError, match="tile_size is 0"):  # a ValueError of the rasterizer
        resolve("default", {("execution", "tile_size"): 0})


def test_options_of_a_fit_win_over_its_quality():
    draft, high = Recipe(quality="draft"), Recipe(quality="high", minutes=2.0)
    assert (draft.settings({}).seconds, draft.settings({}).steps) == (None, 2_000)
    assert draft.settings({("steps",): 9}).steps == 9
    assert draft.settings({("steps",): 9}).seconds is None
    assert (high.settings({}).seconds, high.settings({}).steps) == (120, None)
    assert high.settings({("max_gaussians",): 7}).max_gaussians == 7


def test_a_strategy_in_a_new_file_is_a_choice_with_its_options(add_strategy, tmp_path):
    fields = ("pace: float = 2.0", '"""Seconds of waiting."""', "seed: int = 1")
    another = add_strategy("throw-away", "Edit nothing, slowly.", *fields)
    assert "|single-pass|throw-away" in gsedit("edit", "--help-all").stdout
    listed = settings_of_edit()
    assert (listed["strategy.pace"]["default"], listed["strategy.seed"]["default"]) == ("2", "1")
    given = {("strategy",): "throw-away", ("strategy", "pace"): 0.5}
    assert resolve("default", given)[1] == another(pace=0.5)
    words = ("make it impressionist", "-o", tmp_path / "out", "--set", "pace=1")
    refused = gsedit("edit", "a.ply", *words)
    assert refused.exit_code == 2
    assert "--strategy throw-away" in refused.stderr
    assert not (tmp_path / "out").exists()
    add_strategy("another", "Edit nothing.", "update_steps: float = 1.0")
    with pytest.raises(TypeError, match=r"strategy.update_steps of .* another name"):
        edit_settings()
