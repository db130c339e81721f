"""Parts of an object under a click: what they hold, and where there are none."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import pytest
import torch
from playroom import playroom
from regions_iou import iou

from gsedit.bench.synthetic.paint import checker, mix, plain
from gsedit.bench.synthetic.paint import parts as painted
from gsedit.bench.synthetic.scene import SyntheticScene
from gsedit.bench.synthetic.shapes import box, cylinder, smooth_union, sphere, translate, union
from gsedit.bench.synthetic.splats import surface_gaussians
from gsedit.select import Click, Selector
from gsedit.select import parts as rules
from gsedit.select.parts import parts
from gsedit.select.surfaces import Surfaces, look
from gsedit.views.orbit import circle

GREY = plain((0.5, 0.5, 0.5))
CHECKERED = mix(GREY, plain((0.6, 0.6, 0.45)), checker(0.1))
UP = torch.tensor((0.0, 0.0, 1.0), dtype=torch.float64)
RADIUS = 0.2


@dataclass(frozen=True, eq=False)
class Thing:
    """A whole object and the way it is looked at."""

    surfaces: Surfaces

    def parts_at(self, place):
        """The parts that hold what is at a place of the surface."""
        away = np.linalg.norm(self.surfaces.points - place, axis=1)
        seeds = np.exp(-np.square(away / (away.min() + 0.02)))
        return list(parts(self.surfaces, np.full(len(self.surfaces), True), seeds))

    def in_ball(self, center, radius=RADIUS):
        """Flag the Gaussians of a ball."""
        return np.linalg.norm(self.surfaces.points - center, axis=1) < 1.03 * radius


def thing(solid, coat=GREY, count=3000):
    whole = SyntheticScene("thing", solid, coat, UP, 1.7, UP)
    scene = surface_gaussians(whole, count, torch.Generator().manual_seed(0))
    east = torch.tensor((1.0, 0.0, 0.0), dtype=torch.float64)
    middle = scene.means.double().mean(0)
    cameras = circle(middle, 1.4, UP, 8, 96, elevation=25.0, fov=50.0, start=-90.0, east=east)
    return Thing(look(scene, cameras))


@pytest.mark.parametrize("center", [(0.0, 0.0, 0.46), (0.5, 0.0, 0.0)], ids=["on top", "beside"])
def test_a_ball_that_grows_from_a_box_is_a_part_and_so_is_the_box(center):
    both = thing(union(box((0.35, 0.35, 0.3)), sphere(RADIUS, center)))
    ball = both.in_ball(center)
    outward = np.array(center) * (1 + RADIUS / np.linalg.norm(center))
    whole, found = both.parts_at(outward)[:2]
    assert whole.all()
    assert iou(found, ball) > 0.9
    if center[2]:  # the rest of what it stands on is a part however small the ball is
        assert iou(both.parts_at((0.35, 0.0, 0.0))[1], ~ball) > 0.9


def test_the_middle_of_three_that_stand_on_each_other_comes_before_the_top_is_left():
    """Each step takes what is above a level top: two things, then one of them."""
    tower = union(
        box((0.4, 0.4, 0.1)),
        translate(box((0.22, 0.22, 0.15)), (0, 0, 0.25)),
        translate(box((0.1, 0.1, 0.12)), (0, 0, 0.52)),
    )
    three = thing(tower)
    heights = three.surfaces.heights
    _, upper, top = three.parts_at((0.0, 0.0, 0.64))[:3]
    assert iou(upper, heights > 0.1) > 0.9
    assert iou(top, heights > 0.41) > 0.9


def test_a_strip_of_another_color_is_a_part_and_so_is_what_it_parts():
    def strip(points):
        return points[..., 2].abs() - 0.12

    coat = painted((strip, plain((0.8, 0.2, 0.2))), (lambda p: -strip(p), plain((0.3, 0.35, 0.8))))
    ball = thing(sphere(0.4), coat)
    heights = ball.surfaces.points[:, 2]
    assert iou(ball.parts_at((0.4, 0.0, 0.0))[1], np.abs(heights) < 0.12) > 0.85
    assert iou(ball.parts_at((0.0, 0.1, 0.39))[1], heights > 0.12) > 0.9


def test_a_neck_without_a_crease_parts_two_of_one_color():
    ends = (0.0, -0.32, 0.0), (0.0, 0.32, 0.0)
    two = thing(smooth_union(0.2, *(sphere(0.28, each) for each in ends)))
    assert iou(two.parts_at((0.0, -0.6, 0.0))[1], two.surfaces.points[:, 1] < 0) > 0.9


@pytest.mark.parametrize("coat", [GREY, CHECKERED], ids=["plain", "checkered"])
@pytest.mark.parametrize(
    "solid",
    [sphere(0.4), box((0.3, 0.3, 0.3)), box((0.5, 0.3, 0.08)), cylinder(0.2, 0.5)],
    ids=["sphere", "cube", "slab", "column"],
)
def test_a_convex_thing_has_no_parts_whatever_it_is_painted_with(solid, coat):
    one = thing(solid, coat)
    shown = np.flatnonzero(one.surfaces.seen > 1)
    for place in one.surfaces.points[shown[:: len(shown) // 6]]:
        assert len(one.parts_at(place)) == 1


def test_parts_are_one_in_the_other_and_hold_the_click_and_are_no_specks():
    tree = thing(union(*(sphere(0.32 - 0.06 * i, (0.0, 0.0, 0.42 * i)) for i in range(4))))
    found = tree.parts_at((0.0, 0.0, 1.4))
    top = tree.surfaces.heights.argmax()
    seen = [tree.surfaces.seen[each].sum() for each in found]
    assert 1 < len(found) <= rules.LEVELS
    assert all(each[top] for each in found)
    assert seen[-1] >= rules.LEAST * seen[0]
    assert not any((smaller & ~larger).any() for larger, smaller in pairwise(found))
    assert all(smaller.sum() < larger.sum() for larger, smaller in pairwise(found))


@pytest.fixture(scope="module")
def room():
    return playroom()


@pytest.fixture(scope="module")
def snowman(room):
    """A selector of two balls that are one object, on a ground, and clicks on the upper one."""
    lower, upper = (0.0, 0.0, -0.2), (0.0, 0.0, 0.16)
    solids = union(sphere(0.28, lower), sphere(0.18, upper))
    ground = translate(cylinder(1.5, 0.06), (0, 0, -0.53))
    whole = SyntheticScene("snowman", union(ground, solids), GREY, UP, 1.7, UP)
    scene = surface_gaussians(whole, 10_000, torch.Generator().manual_seed(0))
    camera = room.cameras[0]
    x, y = camera.project(torch.tensor((0.0, -0.18, 0.16), dtype=torch.float64))[0].tolist()
    return Selector(scene, room.cameras), Click(camera, x, y)


def test_the_same_place_again_takes_a_part_and_the_note_says_so(snowman):
    selector, click = snowman
    height = selector.scene.means[:, 2]
    whole, part, still = (selector.at([click] * count) for count in (1, 2, 5))
    assert iou(whole.inside, height > -0.47) > 0.9
    assert iou(part.inside, height > 0.03) > 0.9
    assert "part" not in whole.note
    assert part.note.startswith("part 1 of object 0 at view:")
    assert still.note.endswith("which has no smaller part there")
    assert iou(still.inside, part.inside) > 0.99


def test_a_hand_that_moves_a_little_means_the_same_place_and_another_view_does_not(snowman, room):
    selector, click = snowman
    again = replace(click, x=click.x + 0.5)
    assert torch.equal(selector.at([click, again]).inside, selector.at([click] * 2).inside)
    aside = replace(click, x=click.x + 2)
    other = replace(click, camera=room.cameras[4])
    for clicks in ([click, aside], [click, other], [click, replace(click, inside=False)]):
        assert "part" not in selector.at(clicks).note


def test_a_part_is_refined_by_further_clicks_as_an_object_is(snowman, room):
    selector, click = snowman
    camera = room.cameras[0]
    x, y = camera.project(torch.tensor((0.0, -0.27, -0.2), dtype=torch.float64))[0].tolist()
    found = selector.at([click, click, Click(camera, x, y)]).inside
    part = selector.at([click, click]).inside
    assert (found & ~part).any()
    assert (part & ~found).sum() == 0
