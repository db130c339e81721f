"""One view of an edit before it is done: what routes change, and candidates of a 2D editor."""

import pytest
import torch
from labelled import statue

from gsedit.editing.edit import change_steps
from gsedit.editing.preview import preview_exact
from gsedit.measures.formulas import psnr
from gsedit.run.events import returned
from gsedit.select.finder import Finder
from gsedit.views.orbit import circle
from gsedit.views.viewpoints import Viewpoint
from gsedit.words.read import read_instruction
from rasterizer.render import render_picture

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
    torch.testing.assert_close(found.after.image, 0.8 * before, atol=0.01, rtol=0)
    assert found.picture().width > found.picture().height


def test_a_preview_of_a_material_is_as_the_edit_shows_it(labelled, viewpoints):
    """Reflections are computed of what the view shows: the picture is that of the whole edit."""
    scene, asked = labelled.gaussians, read_instruction("make it polished bronze")
    inside = "sphere:0,0,0,0.3"
    found = preview_exact(scene, asked, viewpoints, inside)
    with torch.no_grad():
        changed = returned(change_steps(Finder(scene, viewpoints, inside), (asked,)))
        whole = render_picture(changed.scene, viewpoints[0].camera)
    assert psnr(found.after.image, whole) > 40
    assert psnr(found.before.image, whole) < 30
