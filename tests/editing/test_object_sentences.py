"""Sentences about objects, from the words to the pictures, on a staged scene."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
import torch
from bench.staged import stage
from changes import changed_by

import gsedit
from gsedit.editing.preview import preview_exact
from gsedit.scene.cache import SceneCache
from gsedit.select.finder import Finder, Names
from gsedit.views.dataset import Dataset, capture
from gsedit.views.viewpoints import Viewpoint, viewpoints_of
from gsedit.words.read import read_instruction
from rasterizer.render import render_picture

STAGE = stage("meadow")


@pytest.fixture(scope="module")
def meadow():
    """A ball and a post on grass: 2,500 Gaussians, whose each is, and views of them."""
    labelled = STAGE.gaussians(2500)
    cameras = STAGE.training(64)
    views = Dataset(capture(labelled.scene, cameras, [str(i) for i in range(len(cameras))]))
    red = lambda x: (x[:, 0] > x[:, 2] + 1).float()  # noqa: E731 (of normalised colors)
    with SceneCache(labelled.scene).used(), pytest.MonkeyPatch.context() as patch:
        patch.setattr("gsedit.select.subject.load_network", lambda: red)  # the subject is the ball
        yield labelled, views


def finder(labelled, views, names=None):
    return Finder(labelled.scene, viewpoints_of(views), names=names)


def test_what_is_named_is_removed_and_the_rest_is_lit_anew(meadow):
    labelled, views = meadow
    result = gsedit.edit(labelled.scene, "remove the red one and make it darker", views=views)
    assert result.region_before is not None
    ball, post = (labelled.of(name) for name in ("red ball", "blue post"))
    known = torch.unique(result.scene.means, dim=0)
    left = torch.isin(labelled.scene.means[:, 0], known[:, 0])
    assert not left[ball].any()
    assert left[post].float().mean() > 0.95
    assert result.held_out.finals[0].image.mean() < result.held_out.originals[0].image.mean()


def test_a_copy_is_painted_and_the_original_is_not(meadow):
    labelled, views = meadow
    words = "duplicate the red one and paint it green"
    result = gsedit.edit(labelled.scene, words, views=views)
    ball = labelled.of("red ball")
    count = len(labelled.scene)
    assert len(result.scene) > count + 0.8 * ball.sum()
    green = result.scene.sh[:, 0, 1] > result.scene.sh[:, 0, 0]
    assert green[count:].float().mean() > 0.9
    assert green[:count][ball].float().mean() < 0.1


@dataclass(frozen=True)
class Segmenter:
    """Masks that know what is called what."""

    name: str = "truth"

    def check(self, phrase: str) -> None:
        """A check that refuses nothing."""

    def masks(self, pictures, phrase):
        thing = {"the ball": "red ball", "the post": "blue post"}[phrase]
        for camera in STAGE.training(pictures[0].shape[0]):
            yield STAGE.mask(camera, thing).float()


def test_with_masks_nouns_are_what_a_network_finds(meadow):
    labelled, views = meadow
    words = "keep only the post"
    result = gsedit.edit(labelled.scene, words, views=views, names=Names(masks=Segmenter()))
    assert result.region_before is not None
    kept = ~result.region_before.inside
    assert kept[labelled.of("blue post")].float().mean() > 0.9
    assert kept[labelled.of("red ball")].float().mean() < 0.1


def test_a_saved_name_is_what_it_was_saved_as(meadow, tmp_path):
    labelled, views = meadow
    ball = labelled.of("red ball")
    np.save(tmp_path / "globe.npy", ball.numpy())
    names = Names({"globe": tmp_path / "globe.npy"})
    routed = changed_by("keep only the globe", finder(labelled, views, names))
    assert torch.equal(routed.scene.means, labelled.scene.means[ball])


@pytest.mark.parametrize(
    ("sentence", "told"),
    [
        ("remove the purple one", "purple"), ("remove the tall one and the small one", "."),
        ("move the ball next to the post", "only a network knows"),
    ],
)  # fmt: skip
def test_what_is_not_there_or_not_plain_is_an_error_of_one_line(meadow, sentence, told):
    labelled, views = meadow
    with pytest.raises(gsedit.UsageError, match=told) as error:
        gsedit.edit(labelled.scene, sentence, views=views)
    assert "\n" not in str(error.value)


def test_where_several_objects_are_comparable_an_unknown_noun_is_refused(quick_saliency):
    corner = stage("corner")
    labelled = corner.gaussians(3000)
    views = [Viewpoint(str(i), camera) for i, camera in enumerate(corner.training(64))]
    with pytest.raises(gsedit.UsageError, match="no main subject stands out") as error:
        changed_by("remove the car", Finder(labelled.scene, views))
    assert "'object 1' (yellow, in the m" in str(error.value)
    assert "--as car" in str(error.value)
    assert "\n" not in str(error.value)


def test_a_look_reaches_what_a_phrase_names(meadow):
    labelled, views = meadow
    changed = changed_by("make the blue one darker", finder(labelled, views))
    different = (changed.scene.sh != labelled.scene.sh).flatten(1).any(dim=1)
    assert different[labelled.of("blue post")].float().mean() > 0.9
    assert different[labelled.of("red ball")].float().mean() < 0.1


def test_a_preview_is_of_the_objects_that_the_edit_finds(meadow):
    labelled, views = meadow
    asked, viewpoints = read_instruction("remove the red one"), viewpoints_of(views)
    shown = preview_exact(labelled.scene, asked, viewpoints)
    done = changed_by(asked.text, finder(labelled, views))
    with torch.no_grad():
        picture = render_picture(done.scene, viewpoints[0].camera)
    torch.testing.assert_close(shown.after.image, picture, atol=1e-4, rtol=0)
    assert shown.notes == (f"region: {done.region.note}", *done.notes)
