"""Previews: what a sentence makes of the scene on the page, found once."""

from pathlib import Path

import pytest
import torch
from playroom import playroom

from gsedit.app.loaded import Loaded
from gsedit.app.panels.select import Clicks, grown
from gsedit.app.previews import Previewer
from gsedit.app.reading import read
from gsedit.select.click import Click, Selector
from gsedit.select.region import Region, save_region
from gsedit.views.viewpoints import Viewpoint
from rasterizer.numerics import DEFAULT
from rasterizer.render import render_picture


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    found = playroom()
    file = tmp_path_factory.mktemp("room") / "room.ply"
    made = Loaded(file, found.scene, DEFAULT, (), draft_gaussians=len(found.scene) // 3)
    views = tuple(Viewpoint(f"{i}.png", camera) for i, camera in enumerate(found.cameras))
    made.__dict__["recorded"] = views  # there is no file beside it
    return made


def region_of(folder: Path, flags):
    path = folder / "selection.npy"
    save_region(Region(flags, "test"), path, overwrite=True)
    return path


def test_a_preview_of_the_selection_changes_the_selection_alone(room, tmp_path):
    ball = playroom().of("red ball")
    routed = Previewer(room, region_of(tmp_path, ball)).scene(read("paint it blue"))
    changed = (routed.scene.sh[:, 0] != room.scene.sh[:, 0]).any(1)
    assert changed[ball].all()
    assert not changed[~ball].any()


def test_a_preview_for_one_view_is_right_in_that_view(room, tmp_path):
    previewer = Previewer(room, region_of(tmp_path, playroom().of("red ball")))
    reading, camera = read("turn it into gold"), playroom().cameras[0]
    assert previewer.is_partial(reading)
    partial, whole = (previewer.scene(reading, each).scene for each in (camera, None))
    pictures = [render_picture(each, camera) for each in (partial, whole, room.scene)]
    assert (pictures[0] - pictures[1]).square().mean() < 1e-3 * (
        pictures[2] - pictures[1]
    ).square().mean() + 1e-6


def test_a_plain_click_at_the_same_place_takes_the_part_there_and_at_last_the_whole_again(room):
    camera = playroom().cameras[0]
    x, y = camera.project(room.scene.means[playroom().of("red ball")].mean(0))[0].tolist()
    selector, clicks, taken = Selector(room.scene, playroom().cameras), Clicks(), []
    for _ in range(6):
        clicks, region = clicks.with_click(Click(camera, x, y), add=False).selected(selector)
        taken.append((len(clicks.clicks), int(region.inside.sum())))
        if len(taken) > 1 and len(clicks.clicks) == 1:
            break
    assert taken[-1] == taken[0]
    assert [count for count, _ in taken[:-1]] == list(range(1, len(taken)))


def test_grow_and_shrink_go_by_a_radius(room):
    flags, means = playroom().of("red ball"), room.scene.means
    larger, smaller = grown(room.scene, flags, 0.1), grown(room.scene, flags, -0.1)
    assert (larger | ~flags).all()
    assert (~smaller | flags).all()
    added = means[larger & ~flags]
    assert torch.cdist(added, means[flags]).amin(1).max() <= 0.1 + 1e-6
    gone = means[flags & ~smaller]
    assert torch.cdist(gone, means[~flags]).amin(1).max() <= 0.1 + 1e-6


def test_a_prepared_preview_is_that_of_the_edit(room):
    reading, previewer = read("make it snow"), Previewer(room, None)
    plain = previewer.scene(reading).scene
    previewer.prepare(sentences=("make it night",))
    assert torch.equal(previewer.scene(reading).scene.sh, plain.sh)
    room.forget()


@pytest.mark.parametrize("sentence", ["turn it into gold", "make it night", "remove it"])
def test_a_glimpse_is_about_what_the_preview_becomes(room, tmp_path, sentence):
    previewer = Previewer(room, region_of(tmp_path, playroom().of("red ball")))
    reading, camera = read(sentence), playroom().cameras[0].fitted(64)
    made = previewer.glimpse(reading, camera), previewer.scene(reading).scene, room.scene
    glimpse, whole, before = (render_picture(each, camera) for each in made)
    assert (glimpse - whole).square().mean() < 0.5 * (before - whole).square().mean()
    room.forget()
