"""The options of `gsedit edit` are the library's settings and those of its strategies."""

from __future__ import annotations

import json
import sys

import pytest
from command_line import gsedit
from gsedit_cli.options.editing import edit_settings, resolve
from gsedit_cli.verbs.fit import Recipe

from gsedit import EditSettings
from gsedit.errors import UsageError
from gsedit.paper import strategies
from gsedit.paper.settings import find_preset
from gsedit.paper.strategies.single_pass import SinglePass

FLAGS = (
    "--steps --guidance --image-guidance --temperature --consensus --solver --memory --precision "
    "--update-steps --patches --patch --loss --views --batches --coverage --overlap "
    "--geometry --condition --kernel"
)


def settings_of_edit() -> dict[str, dict[str, str]]:
    """The settings that `gsedit list` names, by their flags."""
    done = gsedit("list", "settings", "edit", "--json")
    assert done.exit_code == 0, done.stderr
    return {each["flag"]: each for each in map(json.loads, done.stdout.splitlines())}


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
        return strategies.find_strategy(name)

    yield add
    for module in added:
        sys.modules.pop(f"{strategies.__name__}.{module}", None)
        delattr(strategies, module)


def test_what_is_not_given_is_the_librarys_choice():
    assert resolve("default", {}) == (EditSettings(), SinglePass())
    assert resolve("paper", {})[0] == find_preset("paper").settings
    other = strategies.find_strategy("iterative")()
    assert resolve("paper", {("strategy",): "iterative"})[1] == other
    given = {("sampler", "steps"): 7, ("strategy", "update_steps"): 9, ("views_per_batch",): 2}
    some, strategy = resolve("paper", given)
    assert (some.sampler.steps, some.sampler.target, some.views_per_batch) == (7, "xt", 2)
    assert strategy.update_steps == 9
    with pytest.raises(UsageError, match="preset"):
        resolve("newspaper", {})
    with pytest.raises(UsageError, match="tile_size is 0"):  # a ValueError of the rasterizer
        resolve("default", {("execution", "tile_size"): 0})


def test_options_of_a_fit_win_over_its_quality():
    draft, high = Recipe(quality="draft"), Recipe(quality="high", minutes=2.0)
    assert draft.settings({}).seconds
    assert draft.settings({("steps",): 9}).steps == 9
    assert draft.settings({("steps",): 9}).seconds is None
    assert (high.settings({}).seconds, high.settings({}).steps) == (120, None)
    assert high.settings({("max_gaussians",): 7}).max_gaussians == 7


def test_flags_are_those_that_users_know_and_no_two_are_equal():
    flags = [setting.flag for setting in edit_settings()]
    assert set(FLAGS.split()) <= set(flags)
    assert len(flags) == len(set(flags))


@pytest.mark.parametrize("verb", ["fit", "render", "style", "capture"])
def test_other_verbs_list_their_settings(verb):
    assert len(gsedit("list", "settings", verb).stdout.splitlines()) >= 2


def test_a_strategy_in_a_new_file_is_a_choice_with_its_options(add_strategy, tmp_path):
    fields = ("pace: float = 2.0", '"""Seconds of waiting."""', "seed: int = 1", "size: int = 2")
    another = add_strategy("throw-away", "Edit nothing, slowly.", *fields)
    assert "|single-pass|throw-away" in gsedit("edit", "--help-all").stdout
    listed = settings_of_edit()
    assert (listed["--pace"]["default"], listed["--strategy-seed"]["default"]) == ("2", "1")
    given = {("strategy",): "throw-away", ("strategy", "pace"): 0.5, ("strategy", "size"): 5}
    assert resolve("default", given)[1] == another(pace=0.5, size=5)
    refused = gsedit("edit", "a.ply", "make it snow", "-o", tmp_path / "out", "--pace", 1)
    assert refused.exit_code == 2
    assert "--strategy throw-away" in refused.stderr
    assert not (tmp_path / "out").exists()


def test_strategies_share_an_option_only_if_its_type_is_the_same(add_strategy):
    add_strategy("throw-away", "Edit nothing.", "update_steps: float = 1.0")
    with pytest.raises(TypeError, match=r"--update-steps of .* update_steps \(float\), .* \(int\)"):
        edit_settings()
