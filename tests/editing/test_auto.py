"""Edits in which changes go by routes of their own, from Python."""

from __future__ import annotations

from dataclasses import dataclass, replace

import pytest
import tiny_edits
import torch

import gsedit
from gsedit.datasets.dataset import capture
from gsedit.datasets.viewpoints import viewpoints_of
from gsedit.editing.routes.plan import steps_of
from gsedit.editing.routes.result import routed_result
from gsedit.editing.session.settings import EditSettings
from gsedit.editors import make_editor
from gsedit.errors import UsageError
from gsedit.fitting.settings import UpdateSettings
from gsedit.words.instruction import Change, Instruction
from gsedit.words.read import read_instruction

BRIGHTER = Change("scene", "tone", "brightness", None, 0.2, "tone")


def test_python_edits_by_the_route_of_the_sentence(tmp_path):
    scene = tiny_edits.scene()
    result = gsedit.edit(scene, "make it 20% brighter", dataset=tiny_edits.data())
    assert result.strategy_name == "routes"
    assert result.understood is not None
    assert torch.allclose(result.scene.sh[:, 1:], 1.2 * scene.sh[:, 1:], atol=1e-5)
    assert result.metrics.rmse_to_unedited is not None
    assert len(result.held_out.finals) == 2  # of nine views
    gsedit.write_edit(tmp_path / "out", result)
    assert (tmp_path / "out" / "edit.json").is_file()


def test_routes_take_turns_in_the_order_of_the_sentence(monkeypatch):
    scene, data, asked = tiny_edits.scene(), tiny_edits.data(), []

    def edit_steps(given, prompt, **_):
        asked.append((given, prompt))
        read = Instruction(prompt, True, "", (BRIGHTER,))
        yield replace(routed_result(given, read, viewpoints_of(data)), strategy_name="drawn")

    monkeypatch.setattr("gsedit.editing.auto.edit_steps", edit_steps)
    words = "make it 20% brighter, then an impressionist painting, then in black and white"
    result = gsedit.edit(scene, words, dataset=data)
    (given, prompt), = asked  # fmt: skip
    assert prompt != words
    assert torch.allclose(given.sh[:, 1:], 1.2 * scene.sh[:, 1:], atol=1e-5)
    gray = result.held_out.finals[0].image
    assert float((gray - gray.mean(-1, keepdim=True)).abs().mean()) < 0.02


def test_views_that_are_found_are_not_rendered_for_their_cameras(monkeypatch):
    scene, rendered = tiny_edits.scene(), []

    def counted(scene, cameras, *rest):
        rendered.append(len(cameras))
        return capture(scene, cameras, *rest)

    for module in ("datasets.viewpoints", "editing.routes.result"):
        monkeypatch.setattr(f"gsedit.{module}.capture", counted)
    result = gsedit.edit(scene, "make it 20% brighter, then in black and white")
    assert rendered  # the held-out views that are measured and shown
    assert all(count == len(result.held_out.finals) for count in rendered)


def test_a_look_that_nothing_draws_is_told_and_not_what_stands_beside_it():
    with pytest.raises(gsedit.UsageError, match="look: cubist: small does not draw"):
        steps_of(read_instruction("remove the bear and make it cubist"))


@dataclass(frozen=True)
class Blank:
    """Masks that are never asked for."""

    name: str = "blank"

    def check(self, phrase: str) -> None:
        """A check that refuses nothing."""

    def masks(self, pictures, phrase):
        """No masks of these pictures."""
        raise AssertionError("masks were asked for")


def test_masks_are_refused_where_a_2d_editor_draws():
    given = {"dataset": tiny_edits.data(), "masks": Blank()}
    for prompt, editor in (("make it impressionist", None), ("make it darker", make_editor())):
        with pytest.raises(UsageError, match="a 2D editor draws this"):
            gsedit.edit(tiny_edits.scene(), prompt, editor=editor, **given)


def test_a_refused_sentence_is_an_error():
    with pytest.raises(UsageError, match="must not"):
        gsedit.edit(tiny_edits.scene(), "do not paint it red", dataset=tiny_edits.data())


def test_what_changes_hardly_anything_is_told():
    scene, data = tiny_edits.scene(), tiny_edits.data()
    gray = gsedit.edit(scene, "in black and white", dataset=data)
    assert gray.notes == ()
    again = gsedit.edit(gray.scene, "in black and white", dataset=data)
    assert any("hardly anything changed" in note for note in again.notes)


@pytest.mark.parametrize(
    ("settings", "drawn"),
    [
        (EditSettings(region="all"), False),
        (EditSettings(geometry="full"), True),
        (EditSettings(update=UpdateSettings(loss="mse+gram")), True),
    ],
)
def test_a_setting_of_the_2d_editor_asks_for_it(monkeypatch, settings, drawn):
    scene, data, asked = tiny_edits.scene(), tiny_edits.data(), []

    def edit_steps(given, prompt, **_):
        asked.append(prompt)
        yield routed_result(given, Instruction(prompt, True, "", (BRIGHTER,)), viewpoints_of(data))

    monkeypatch.setattr("gsedit.editing.auto.edit_steps", edit_steps)
    gsedit.edit(scene, "make it 20% brighter", dataset=data, settings=settings)
    assert bool(asked) == drawn
