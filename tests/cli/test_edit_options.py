"""The options of `gsedit edit` are the library's settings and those of its strategies."""

from __future__ import annotations

import json
import sys

import pytest
from command_line import gsedit, one_line
from gsedit_cli.options.editing import edit_settings, resolve

from gsedit import EditSettings
from gsedit.editing import strategies
from gsedit.editing.session.presets import find_preset
from gsedit.editing.strategies.single_pass import SinglePass
from gsedit.errors import UsageError

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


@pytest.fixture
def another_strategy(add_strategy):
    """A second strategy, which shares one setting with the first."""
    return add_strategy(
        "throw-away",
        "Edit nothing, slowly.",
        "pace: float = 2.0",
        '"""Seconds of waiting."""',
        "update_steps: int = 3",
        '"""Steps after it."""',
    )


def test_what_is_not_given_is_the_librarys_choice():
    assert resolve("default", {}) == (EditSettings(), SinglePass())
    paper, printed = resolve("paper", {})
    assert (paper, printed.update_steps) == (find_preset("paper").settings, 200)
    assert (
        resolve("paper", {("strategy",): "iterative"})[1] == strategies.find_strategy("iterative")()
    )
    some, strategy = resolve(
        "paper",
        {
            ("sampler", "steps"): 7,
            ("sampler", "consensus"): False,
            ("strategy", "update_steps"): 9,
            ("views_per_batch",): 2,
        },
    )
    assert (some.sampler.steps, some.sampler.consensus, some.sampler.target) == (7, False, "xt")
    assert (strategy.update_steps, some.views_per_batch) == (9, 2)
    assert resolve("default", {("execution", "kernel"): "torch"})[0].execution.kernel == "torch"
    with pytest.raises(UsageError, match="preset"):
        resolve("newspaper", {})
    with pytest.raises(UsageError, match="tile_size is 0"):  # a ValueError of the rasterizer
        resolve("default", {("execution", "tile_size"): 0})


def test_flags_are_those_that_users_know_and_no_two_are_equal():
    flags = [setting.flag for setting in edit_settings()]
    assert set(FLAGS.split()) <= set(flags)
    assert len(flags) == len(set(flags))


@pytest.mark.parametrize("verb", ["fit", "render", "style", "capture"])
def test_other_verbs_list_their_settings(verb):
    done = gsedit("list", "settings", verb)
    assert done.exit_code == 0, done.stderr
    assert len(done.stdout.splitlines()) >= 2


def test_a_strategy_in_a_new_file_is_a_choice_with_its_options(another_strategy):
    assert "|single-pass|throw-away" in gsedit("edit", "--help-all").stdout
    listed = settings_of_edit()
    assert listed["--pace"]["meaning"] == "Seconds of waiting. Of throw-away."
    assert listed["--pace"]["default"] == "2"
    assert listed["--update-steps"]["default"] == "by strategy"
    assert "throw-away" in listed["--update-steps"]["meaning"]
    _, strategy = resolve("default", {("strategy",): "throw-away", ("strategy", "pace"): 0.5})
    assert strategy == another_strategy(pace=0.5)
    _, strategy = resolve("default", {("strategy", "update_steps"): 8})
    assert strategy == SinglePass(8)


def test_a_setting_with_the_name_of_an_option_of_the_verb_gets_a_prefix(add_strategy, tmp_path):
    strategy = add_strategy("throw-away", "Edit nothing.", "seed: int = 1", "size: int = 2")
    assert settings_of_edit()["--strategy-seed"]["default"] == "1"
    assert gsedit("edit", "--help-all").stdout.count(" --seed ") == 1
    values = {("strategy",): "throw-away", ("strategy", "size"): 5}
    assert resolve("default", values)[1] == strategy(size=5)
    result = gsedit("edit", "a.ply", "snow", "-o", tmp_path / "out", "--strategy-size", 5)
    assert "--strategy-size is an option of the strategy throw-away" in result.stderr
    result = gsedit("edit", tmp_path / "no.ply", "snow", "-o", tmp_path / "out", "--size", 40)
    assert "no.ply" in result.stderr
    assert "--size" not in result.stderr


def test_strategies_share_an_option_only_if_its_type_is_the_same(add_strategy):
    add_strategy("throw-away", "Edit nothing.", "update_steps: float = 1.0")
    with pytest.raises(TypeError, match=r"--update-steps of .* update_steps \(float\), .* \(int\)"):
        edit_settings()


def test_an_option_of_another_strategy_is_refused(another_strategy, tmp_path):
    result = gsedit("edit", "a.ply", "make it snow", "-o", tmp_path / "out", "--pace", 1)
    assert result.exit_code == 2
    assert one_line(result.stderr)
    assert "--pace is an option of the strategy throw-away, not of single-pass" in result.stderr
    assert "--strategy throw-away" in result.stderr
    assert not (tmp_path / "out").exists()
    assert gsedit("edit", "a.ply", "snow", "-o", tmp_path / "out", "--strategy", "x").exit_code == 2
