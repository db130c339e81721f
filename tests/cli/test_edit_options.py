"""The options of `gsedit edit` are the library's settings and those of its strategies."""

from __future__ import annotations

import re
import sys

import pytest
from command_line import gsedit, one_line
from gsedit_cli.edit_options import edit_settings, resolve

from gsedit import strategies
from gsedit.diffusion import SamplerDefaults, SamplerSettings
from gsedit.editors.small import DEFAULTS
from gsedit.errors import UsageError
from gsedit.fitting.settings import UpdateSettings
from gsedit.session.settings import EditSettings
from gsedit.strategies.single_pass import SinglePass

FLAGS = (
    "--steps --guidance --image-guidance --temperature --consensus --solver --memory --precision "
    "--update-steps --patches --patch --gram-weight --views --rounds --coverage --overlap "
    "--geometry --condition --kernel"
)


def help_of_edit(monkeypatch) -> str:
    """The help without its frames, in one line."""
    monkeypatch.setenv("COLUMNS", "160")
    return " ".join(gsedit("edit", "--help").stdout.replace("│", " ").split())


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
    paper, _ = resolve("paper", {})
    assert paper.sampler == SamplerSettings.preset("paper")
    some, strategy = resolve(
        "paper",
        {
            ("sampler", "steps"): 7,
            ("sampler", "consensus"): False,
            ("strategy", "update_steps"): 9,
            ("views_per_round",): 2,
        },
    )
    assert (some.sampler.steps, some.sampler.consensus, some.sampler.target) == (7, False, "xt")
    assert (strategy.update_steps, some.views_per_round) == (9, 2)
    assert resolve("default", {("execution", "kernel"): "torch"})[0].execution.kernel == "torch"
    with pytest.raises(UsageError, match="preset"):
        resolve("newspaper", {})
    with pytest.raises(UsageError, match="tile_size is 0"):  # a ValueError of the rasteriser
        resolve("default", {("execution", "tile_size"): 0})


def test_flags_are_those_that_users_know_and_no_two_are_equal():
    flags = [setting.flag for setting in edit_settings()]
    assert set(FLAGS.split()) <= set(flags)
    assert len(flags) == len(set(flags))


def test_the_defaults_in_the_help_are_the_librarys(monkeypatch):
    text = help_of_edit(monkeypatch)
    sampler, update, edit = SamplerSettings(), UpdateSettings(), EditSettings()
    pix2pix = SamplerDefaults()
    for value in (
        f"Denoising steps, from 1 to 1000. The time of an edit is proportional to it. "
        f"[default: {sampler.steps}]",
        f"({pix2pix.guidance_text}; small {DEFAULTS.guidance_text:g})]",
        f"({pix2pix.guidance_image}; small {DEFAULTS.guidance_image:g})]",
        f"({pix2pix.temperature:g}; small {DEFAULTS.temperature:g})]",
        f"[default: {SinglePass().update_steps}]",
        f"[default: {update.patches}]",
        f"[default: {update.patch}]",
        f"[default: {update.gram_weight:g}]",
        f"[default: {edit.views_per_round}]",
        f"[default: {edit.rounds}]",
        f"[default: {edit.coverage}]",
        f"[default: {edit.geometry}]",
        f"[default: {edit.condition}]",
    ):
        assert value in text


def test_a_strategy_in_a_new_file_is_a_choice_with_its_options(monkeypatch, another_strategy):
    text = help_of_edit(monkeypatch)
    assert "|single-pass|throw-away>" in text
    assert "throw-away: Edit nothing, slowly." in text
    assert "--pace <float> throw-away: Seconds of waiting. [default: 2]" in text
    default = f"[default: {SinglePass().update_steps}]"
    shared = f"{default} throw-away: Steps after it. [default: 3]"
    assert shared in text
    _, strategy = resolve("default", {("strategy",): "throw-away", ("strategy", "pace"): 0.5})
    assert strategy == another_strategy(pace=0.5)
    _, strategy = resolve("default", {("strategy", "update_steps"): 8})
    assert strategy == SinglePass(8)


def test_a_setting_with_the_name_of_an_option_of_the_verb_gets_a_prefix(
    monkeypatch, add_strategy, tmp_path
):
    strategy = add_strategy("throw-away", "Edit nothing.", "seed: int = 1", "size: int = 2")
    text = help_of_edit(monkeypatch)
    assert "--strategy-seed <int> throw-away: seed. [default: 1]" in text
    assert len(re.findall(r"--seed\b", text)) == 1
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


def test_strategies_may_share_choices(add_strategy):
    choice = "from typing import Literal; mode: Literal['a', 'b'] = 'a'"
    add_strategy("throw-away", "Edit nothing.", choice)
    add_strategy("throw-again", "Edit nothing again.", choice)
    (mode,) = (setting for setting in edit_settings() if setting.flag == "--mode")
    assert mode.help.startswith("throw-again: ")
    assert "throw-away: " in mode.help


def test_an_option_of_another_strategy_is_refused(another_strategy, tmp_path):
    result = gsedit("edit", "a.ply", "make it snow", "-o", tmp_path / "out", "--pace", 1)
    assert result.exit_code == 2
    assert one_line(result.stderr)
    assert "--pace is an option of the strategy throw-away, not of single-pass" in result.stderr
    assert "--strategy throw-away" in result.stderr
    assert not (tmp_path / "out").exists()
    assert gsedit("edit", "a.ply", "snow", "-o", tmp_path / "out", "--strategy", "x").exit_code == 2
