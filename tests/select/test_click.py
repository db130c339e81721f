"""Selecting at a pixel: what a click, more clicks, a box and a mask take."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from playroom import playroom
from regions_iou import iou

from gsedit.bench.synthetic.paint import plain
from gsedit.bench.synthetic.scene import SyntheticScene
from gsedit.bench.synthetic.shapes import box, cylinder, smooth_union, translate, union
from gsedit.bench.synthetic.splats import surface_gaussians
from gsedit.errors import UsageError
from gsedit.scene.similarity import Similarity, moved_camera
from gsedit.select import Click, Selector
from gsedit.select.region import Region, coverage, in_one_color
from gsedit.toolkit import transform
from rasterizer import render
from rasterizer.scene import concatenate

THINGS = ("red ball", "white box", "blue block", "yellow ball")


@pytest.fixture(scope="module")
def room():
    return playroom()


@pytest.fixture(scope="module")
def selector(room):
    return Selector(room.scene, room.cameras)


def shown(room, name, camera):
    """The share of each pixel that an object gives."""
    return render(in_one_color(room.scene, room.of(name)), camera).color[..., 0]


def click_on(room, name, view=0, inside=True):
    """A click in the middle of what a view shows of an object."""
    share = shown(room, name, room.cameras[view])
    rows, columns = (share > 0.6).nonzero().T
    middle = torch.stack((rows, columns), 1).double()
    best = (middle - middle.mean(0)).norm(dim=1).argmin()
    x, y = float(columns[best]) + 0.5, float(rows[best]) + 0.5
    return Click(room.cameras[view], x, y, inside)


@pytest.mark.parametrize("name", THINGS)
def test_a_click_takes_the_whole_object_that_stands_there(room, selector, name):
    for view in (0, 3):
        found = selector.at([click_on(room, name, view)])
        assert iou(found.inside, room.of(name)) > 0.9


def test_a_click_on_the_ground_takes_the_ground(room, selector):
    assert iou(selector.at([click_on(room, "ground")]).inside, room.of("ground")) > 0.9


def test_a_click_inside_another_object_adds_it_and_one_outside_takes_it_away(room, selector):
    both = [click_on(room, "red ball"), click_on(room, "blue block")]
    either = room.of("red ball") | room.of("blue block")
    assert iou(selector.at(both).inside, either) > 0.9
    without = [*both, click_on(room, "blue block", 2, inside=False)]
    assert iou(selector.at(without).inside, room.of("red ball")) > 0.9


def test_a_click_outside_on_what_the_clicked_thing_grows_from_leaves_the_thing(room):
    """A post and its base are one smooth thing: only the level top of the base is a border."""
    base, post = box((0.35, 0.35, 0.12)), translate(box((0.1, 0.1, 0.2)), (0, 0, 0.25))
    ground = translate(cylinder(1.5, 0.06), (0, 0, -0.18))
    solid = union(ground, smooth_union(0.1, base, post))
    up = room.cameras[0].rotation.new_tensor((0.0, 0.0, 1.0))
    whole = SyntheticScene("post", solid, plain((0.5, 0.5, 0.5)), up, 1.7, up)
    scene = surface_gaussians(whole, 3000, torch.Generator().manual_seed(0))
    places = (0, 0, 0.3), (0.2, -0.35, -0.06), (0.25, -0.2, 0.12)
    at = [room.cameras[0].project(up.new_tensor(each))[0].tolist() for each in places]
    on_post, on_side, on_top = (Click(room.cameras[0], *each) for each in at)
    selector, tall = Selector(scene, room.cameras), scene.means[:, 2]
    assert iou(selector.at([on_post, on_side]).inside, tall > -0.1) > 0.9
    found = selector.at([on_post, on_side, replace(on_top, inside=False)])
    for camera in room.cameras[:4]:  # as pictures show it: wide Gaussians of its rim are cut off
        shown = [coverage(each, scene, camera) > 0.5 for each in (found, Region(tall > 0.1))]
        assert iou(*shown) > 0.8


def test_a_click_outside_beside_the_object_changes_nothing(room, selector):
    clicks = [click_on(room, "red ball")]
    after = selector.at([*clicks, click_on(room, "ground", inside=False)])
    assert torch.equal(after.inside, selector.at(clicks).inside)


def test_a_moved_and_scaled_scene_is_selected_alike(room, selector):
    turn = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])
    away = Similarity(turn, 3.0, np.full(3, 5.0))
    cameras = [moved_camera(camera, away) for camera in room.cameras]
    click = click_on(room, "yellow ball")
    found = Selector(transform(room.scene, away), cameras).at([replace(click, camera=cameras[0])])
    assert iou(found.inside, selector.at([click]).inside) > 0.98


def test_a_thing_of_a_long_capture_is_selected_as_in_one_of_its_own(room, selector):
    """Most of the scene is neither near what is clicked nor seen by the views that look at it."""
    away = [
        Similarity(np.eye(3), 1.0, np.array((8.0 * i, 8.0 * k, 0.0)))
        for i in range(3)
        for k in range(2)
    ]
    rooms = [transform(room.scene, each) for each in away]
    cameras = [moved_camera(camera, each) for each in away for camera in room.cameras]
    click = click_on(room, "red ball")
    there = replace(click, camera=moved_camera(click.camera, away[3]))
    found = Selector(concatenate(*rooms), cameras, (8_000, 4_000)).at([there]).inside
    found = found.reshape(len(away), -1)
    assert iou(found[3], room.of("red ball")) > 0.9
    assert found.sum() == found[3].sum()


def test_a_box_takes_the_objects_that_are_in_it(room, selector):
    rows, columns = (shown(room, "blue block", room.cameras[0]) > 0.5).nonzero().T
    corners = columns.min() - 1, rows.min() - 1, columns.max() + 2, rows.max() + 2
    found = selector.box(room.cameras[0], *(float(each) for each in corners))
    assert iou(found.inside, room.of("blue block")) > 0.9


def test_a_mask_takes_the_object_it_covers_or_the_part_it_shows(room, selector):
    camera = room.cameras[0]
    mask = (shown(room, "red ball", camera) > 0.5).float()
    assert iou(selector.mask(camera, mask).inside, room.of("red ball")) > 0.9
    rows = mask.nonzero()[:, 0].float()
    mask[int(rows.mean()) :] = 0
    part = selector.mask(camera, mask).inside
    ball = room.scene.means[room.of("red ball")]
    assert part.any()
    assert room.of("red ball")[part].float().mean() > 0.9
    assert room.scene.means[part, 2].mean() > ball[:, 2].mean()


def test_clicks_that_cannot_be_meant_are_refused_with_the_next_move(room, selector):
    camera = room.cameras[0]
    for clicks, words in (
        ([], "no click is inside"),
        ([Click(camera, 200.0, 5.0, name="photo")], "beside the picture of photo, which has 96x96"),
        ([Click(camera, 0.5, 0.5)], "nothing is at"),
    ):
        with pytest.raises(UsageError, match=words):
            selector.at(clicks)
    with pytest.raises(UsageError, match="no object is in the box"):
        selector.box(camera, 0.0, 0.0, 4.0, 4.0)
    with pytest.raises(UsageError, match="mask has 8x9 pixels"):
        selector.mask(camera, torch.ones(9, 8))


def test_a_lone_object_is_not_selected_as_a_whole_scene(room):
    alone = room.scene[room.of("red ball")]
    with pytest.raises(UsageError, match="whole scene"):
        Selector(alone, room.cameras).at([click_on(room, "red ball")])
