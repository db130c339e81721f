"""The spine: changes of a sentence in their order, each by its painter, found before any change."""

from __future__ import annotations

import pytest
import tiny_edits
import torch

import gsedit
from gsedit.editing.plan import read_steps
from gsedit.errors import UsageError
from gsedit.paper.editors import make_editor, make_masks
from gsedit.select.finder import Names


def test_python_edits_by_the_route_of_the_sentence(tmp_path):
    scene = tiny_edits.scene()
    result = gsedit.edit(scene, "make it 20% brighter", tiny_edits.data())
    assert result.strategy_name == "routes"
    assert result.understood is not None
    assert torch.allclose(result.scene.sh[:, 1:], 1.2 * scene.sh[:, 1:], atol=1e-5)
    assert result.metrics.rmse_to_unedited is not None
    assert len(result.held_out.finals) == 2  # of nine views
    gsedit.write_edit(tmp_path / "out", result)
    assert (tmp_path / "out" / "edit.json").is_file()


def test_masks_are_refused_where_a_2d_editor_draws():
    masks = make_masks("command", run="false {input} {output} {phrase}")  # it is not asked
    given = {"views": tiny_edits.data(), "names": Names(masks=masks)}
    with pytest.raises(UsageError, match="a 2D editor gets this one as it is"):
        gsedit.edit(tiny_edits.scene(), "as gold", editor=make_editor("closed-form"), **given)


def test_a_refused_sentence_is_an_error(quick_saliency):
    with pytest.raises(UsageError, match="must not"):
        gsedit.edit(tiny_edits.scene(), "do not paint it red", tiny_edits.data())
    given = {"steps": read_steps("paint it red")}  # no sentence is read beside them
    gsedit.edit(tiny_edits.scene(), "do not paint it red", tiny_edits.data(), **given)
