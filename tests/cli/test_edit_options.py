"""The options of `gsedit edit` are the library's settings and those of its strategies."""

from __future__ import annotations

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
    "--update-steps --patches --patch --gram-weight --views --rounds --coverage --geometry "
    "--condition --compile"
)


def help_of_edit(monkeypatch) -> str:
    """The help without its frames, in one line."""
    monkeypatch.setenv("COLUMNS", "160")
    return " ".join(gsedit("edit", "--help").stdout.replace("│", " ").split())


@pytest.fixture
def another_strategy(monkeypatch, tmp_path):
    """A second strategy in a file of its own: it shares one setting with the first."""
    (tmp_path / "throw_away.py").write_text(
        "from dataclasses import dataclass\n"
        "@dataclass(frozen=True)\n"
        "class ThrowAway:\n"
        '    """Edit nothing, slowly."""\n'
        "    pace: float = 2.0\n"
        '    """Seconds of waiting."""\n'
        "    update_steps: int = 3\n"
        '    """Steps after it."""\n'
        "    def __call__(self, session): yield from ()\n"
    )
    monkeypatch.setattr(strategies, "__path__", [*strategies.__path__, str(tmp_path)])
    return strategies.find_strategy("throw-away")


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
    assert resolve("default", {("execution", "compile"): True})[0].execution.compile
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
        f"[default: {update.gram_weight}]",
        f"[default: {edit.views_per_round}]",
        f"[default: {edit.rounds}]",
        f"[default: {edit.coverage}]",
        f"[default: {edit.geometry}]",
        f"[default: {edit.condition}]",
    ):
        assert value in text


def test_a_strategy_in_a_new_file_is_a_choice_with_its_options(monkeypatch, another_strategy):
    text = help_of_edit(monkeypatch)
    assert "--strategy <single-pass|throw-away>" in text
    assert "throw-away: Edit nothing, slowly." in text
    assert "--pace <float> throw-away: Seconds of waiting. [default: 2]" in text
    shared = "[default: 200] throw-away: Steps after it. [default: 3]"
    assert shared in text
    _, strategy = resolve("default", {("strategy",): "throw-away", ("strategy", "pace"): 0.5})
    assert strategy == another_strategy(pace=0.5)
    _, strategy = resolve("default", {("strategy", "update_steps"): 8})
    assert strategy == SinglePass(8)


def test_an_option_of_another_strategy_is_refused(another_strategy, tmp_path):
    result = gsedit("edit", "a.ply", "make it snow", "-o", tmp_path / "out", "--pace", 1)
    assert result.exit_code == 2
    assert one_line(result.stderr)
    assert "--pace is an option of the strategy throw-away, not of single-pass" in result.stderr
    assert "--strategy throw-away" in result.stderr
    assert not (tmp_path / "out").exists()
    assert gsedit("edit", "a.ply", "snow", "-o", tmp_path / "out", "--strategy", "x").exit_code == 2
