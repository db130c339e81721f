"""One view of an edit before it is done: what routes change, and candidates of a 2D editor."""

from __future__ import annotations

import pytest
import torch
from labelled import statue

from gsedit.cameras.orbit import circle
from gsedit.datasets.viewpoints import Viewpoint
from gsedit.editing.edit import change_steps
from gsedit.editing.preview import preview_edited, preview_exact
from gsedit.editors import Capabilities, EditProgress, make_editor
from gsedit.measures.metrics import psnr
from gsedit.paper.settings import EditSettings
from gsedit.runs.events import returned
from gsedit.scene.picture import render_picture
from gsedit.select.finder import Finder
from gsedit.words.read import read_instruction

SIZE = 48


@pytest.fixture(scope="module")
def labelled():
    return statue(0, 1500)


@pytest.fixture(scope="module")
def viewpoints(labelled):
    middle = torch.tensor([0.0, 0.0, -0.1], dtype=torch.float64)
    cameras = circle(middle, 0.62, labelled.scene.up, 6, SIZE, elevation=22.0, fov=45.0)
    return [Viewpoint(str(i), camera) for i, camera in enumerate(cameras)]


def test_a_tone_of_the_scene_is_previewed_exactly(labelled, viewpoints):
    scene = labelled.gaussians
    found = preview_exact(scene, read_instruction("make it 20% darker"), viewpoints)
    with torch.no_grad():
        before = render_picture(scene, viewpoints[0].camera)
    assert torch.equal(found.before.image, before)
    torch.testing.assert_close(found.after[0].image, 0.8 * before, atol=0.01, rtol=0)
    assert found.picture().width > found.picture().height


def test_a_preview_of_a_material_is_as_the_edit_shows_it(labelled, viewpoints):
    """Reflections are computed of what the view shows: the picture is that of the whole edit."""
    scene, asked = labelled.gaussians, read_instruction("make it polished bronze")
    inside = EditSettings(region="sphere:0,0,0,0.3")
    found = preview_exact(scene, asked, viewpoints, inside)
    with torch.no_grad():
        changed = returned(change_steps(Finder(scene, viewpoints, inside.region), (asked,)))
        whole = render_picture(changed.scene, viewpoints[0].camera)
    assert psnr(found.after[0].image, whole) > 40
    assert psnr(found.before.image, whole) < 30


def test_seeds_give_candidates_of_one_look(labelled, viewpoints):
    scene, camera = labelled.gaussians, viewpoints[0].camera
    found = preview_edited(scene, "as a pencil sketch", camera, make_editor(), (3, 4, 3))
    assert [view.name for view in found.after] == ["seed 3", "seed 4", "seed 3"]
    first, second, again = (view.image for view in found.after)
    assert torch.equal(first, again)
    assert not torch.equal(first, second)
    assert float((first - found.before.image).abs().mean()) > 0.02


class Enlarging:
    """Swaps red and blue, and was made for twice the size; keeps the size of what it was given."""

    name, cell, capabilities = "enlarging", 4, Capabilities(best_size=2 * SIZE, enlarges=True)

    def check(self, prompt):
        pass

    def edit(self, batch, settings, generator):
        self.given = batch.images.shape[1:3]
        yield EditProgress(1, 1, batch.originals.flip(-1))


def test_a_small_view_is_drawn_at_the_size_that_the_editor_was_made_for(labelled, viewpoints):
    scene, camera, editor = labelled.gaussians, viewpoints[0].camera, Enlarging()
    found = preview_edited(scene, "swap", camera, editor)
    assert editor.given == (2 * SIZE, 2 * SIZE)
    assert found.after[0].image.shape == (SIZE, SIZE, 3)
    assert psnr(found.after[0].image, found.before.image.flip(-1)) > 30
    preview_edited(scene, "swap", camera, editor, size=SIZE // 2)
    assert editor.given == (SIZE // 2, SIZE // 2)
