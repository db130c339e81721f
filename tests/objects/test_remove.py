"""Removing an object: the hole is as if it had never been there, the rest keeps its bits."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np
import pytest
import torch
from bench.staged import stage
from plain_scenes import cloud, same_bits
from torch import Tensor

from gsedit.change.objects import remove
from gsedit.change.objects.removal.belongings import (
    between_feet,
    left_on,
    mirrored_under,
    missed,
)
from gsedit.errors import UsageError
from gsedit.scene.outcome import Outcome
from gsedit.scene.planes import Plane, find_support
from gsedit.select.region import Region, coverage
from gsedit.select.segment import segment_surfaces
from gsedit.select.surfaces import look
from gsedit.views.orbit import circle
from rasterizer.camera import Camera
from rasterizer.render import render
from rasterizer.scene import Gaussians, concatenate

COUNT, SIZE = 4000, 64


@dataclass(frozen=True, eq=False)
class Case:
    """A staged scene and the same without its first thing."""

    scene: Gaussians
    inside: Tensor
    truth: Gaussians
    cameras: tuple[Camera, ...]
    held_out: tuple[Camera, ...]


@lru_cache(4)
def case(name: str) -> Case:
    """A set of bench.staged."""
    set_ = stage(name)
    thing = set_.things[0].name
    labelled = set_.gaussians(COUNT)
    truth, _ = set_.without(thing).gaussians_from(set_, labelled, COUNT)
    cameras = set_.training(SIZE)[::3], set_.held_out(SIZE)[:4]
    return Case(labelled.scene, labelled.of(thing), truth.scene, *cameras)


@lru_cache(4)
def removed(name: str) -> Outcome:
    """The set after `remove`."""
    each = case(name)
    return remove(each.scene, each.inside, each.cameras)


def error_db(each: Case, scene: Gaussians) -> float:
    """Decibels to the truth where held-out views show the object."""
    errors = []
    for camera in each.held_out:
        shown = coverage(Region(each.inside), each.scene, camera)
        hole = shown > 0.1
        truth, shown = render(each.truth, camera).color, render(scene, camera).color
        errors.append((truth - shown)[hole].square().flatten())
    return -10 * float(torch.cat(errors).mean().log10())


@pytest.mark.parametrize("name", ["pedestal", "meadow", "wall", "glimpse"])
def test_the_hole_is_nearly_as_if_the_object_had_never_been_there(name):
    each = case(name)
    dropped = error_db(each, each.scene[~each.inside])
    filled = error_db(each, removed(name).scene)
    assert filled > 23
    assert filled > dropped + 4


@pytest.mark.parametrize("name", ["pedestal", "wall"])
def test_unchanged_gaussians_keep_their_bits_and_the_object_is_gone(name):
    each, outcome = case(name), removed(name)
    same = ~outcome.changed
    before, after = each.scene[outcome.origin[same]], outcome.scene[same]
    assert same_bits(before, after)
    assert outcome.dropped(len(each.scene))[each.inside].all()
    assert all(value.isfinite().all() for value in (outcome.scene.means, outcome.scene.sh))


def test_a_plinth_is_not_continued_over_its_edge():
    each, outcome = case("pedestal"), removed("pedestal")
    made = outcome.scene[outcome.origin < 0].means
    high = each.truth.means[:, 2] > made[:, 2].min() - 0.02
    low, top = each.truth.means[high].aminmax(dim=0)
    reach = 0.05
    assert ((made >= low - reach) & (made <= top + reach))[:, :2].all()


def test_what_else_stands_there_and_its_shadow_keep_their_bits():
    each, outcome = case("glimpse"), removed("glimpse")
    stone = torch.tensor((-0.6, -0.35, -0.45))
    near = (outcome.scene.means - stone).norm(dim=1) < 0.3
    assert near.any()
    assert not outcome.changed[near].any()
    kept = outcome.origin[near]
    assert len(kept) == int(((each.scene.means - stone).norm(dim=1) < 0.3).sum())


@pytest.mark.parametrize("kind", ["eroded", "dilated", "noisy"])
def test_selections_by_people_are_good_enough(kind):
    each = case("meadow")
    generator = torch.Generator().manual_seed(0)
    away = torch.cdist(each.scene.means, each.scene.means[each.inside]).amin(1)
    from_rest = torch.cdist(each.scene.means, each.scene.means[~each.inside]).amin(1)
    flip = torch.rand(len(each.scene), generator=generator) < 0.02
    inside = {
        "eroded": each.inside & (from_rest > 0.05),
        "dilated": away < 0.04,
        "noisy": each.inside ^ flip,
    }[kind]
    assert error_db(each, remove(each.scene, inside, each.cameras).scene) > 22


def floating() -> tuple[Gaussians, Tensor, tuple[Camera, ...]]:
    """Two heaps of Gaussians in nothing."""
    generator = torch.Generator().manual_seed(0)
    places = torch.nn.functional.normalize(torch.randn(800, 3, generator=generator), dim=1)
    heap = cloud(places, math.log(0.08), 0.6)
    both = concatenate(heap, replace(heap, means=places + torch.tensor((4.0, 0, 0))))
    up, middle = torch.tensor((0.0, 0, 1)).double(), torch.tensor((2.0, 0, 0)).double()
    cameras = circle(middle, 4.0, up, 6, 48, elevation=20.0, fov=50.0)
    return both, torch.arange(1600) < 800, cameras


def test_an_object_in_nothing_leaves_nothing():
    scene, inside, cameras = floating()
    outcome = remove(scene, inside, cameras)
    assert len(outcome.scene) == 800
    assert not outcome.changed.any()


def test_its_mirror_image_in_a_glossy_floor_goes_along():
    each, floor = case("meadow"), -0.45
    ball = each.scene[each.inside]
    image = replace(ball, means=ball.means * torch.tensor((1, 1, -1)) + torch.tensor((0, 0, -0.9)))
    level = (each.scene.means[:, 2] - floor).abs() < 0.02
    clear = torch.where(level, 0.4, each.scene.logit_opacities)
    scene = concatenate(replace(each.scene, logit_opacities=clear), image)
    rows = torch.arange(len(scene)) >= len(each.scene)
    inside = torch.cat((each.inside, torch.zeros(len(image), dtype=torch.bool)))
    dropped = remove(scene, inside, each.cameras).dropped(len(scene))
    deep = scene.means[:, 2] < floor - 0.1
    assert dropped[rows & deep].float().mean() > 0.95


def test_a_plate_that_views_saw_a_mirrored_world_in_is_opaque_in_its_color():
    grid = torch.cartesian_prod(*[torch.arange(-1.5, 1.5, 0.05)] * 2)
    level = torch.nn.functional.pad(grid, (0, 1))
    floor = cloud(level[grid.norm(dim=1) > 0.6], (-3.2, -3.2, -6.0), 0.7)
    plate = cloud(level[grid.norm(dim=1) < 0.55], (-3.2, -3.2, -6.0), 0.4, -2.0)
    sky = cloud(3 * level - torch.tensor((0.0, 0.0, 1.5)), (-2.0, -2.0, -5.0), 0.4)
    ways = torch.randn(600, 3, generator=torch.Generator().manual_seed(0))
    places = 0.2 * torch.nn.functional.normalize(ways, dim=1) + torch.tensor((0.0, 0.0, 0.2))
    ball = cloud(places, -3.5, torch.tensor((0.8, 0.1, 0.1)))
    image = replace(ball, means=places * torch.tensor((1, 1, -1)))
    scene, up = concatenate(ball, floor, plate, sky, image), torch.eye(3).double()[2]
    cameras = circle(0 * up, 1.5, up, 12, 96, elevation=35.0, fov=50.0)
    outcome = remove(scene, torch.arange(len(scene)) < len(ball), cameras)
    made = outcome.scene[outcome.origin < 0]
    assert not outcome.changed[outcome.origin >= 0].any()
    assert (made.means.norm(dim=1) < 0.75).all()
    for camera in circle(0 * up, 0.2, up, 3, 32, elevation=50.0, fov=30.0, start=10.0):
        assert ((render(made, camera).color - 0.4).abs() < 0.06).all()  # black shows through


def test_what_is_full_of_points_below_a_thing_is_no_mirror_image_of_it():
    random, up = np.random.default_rng(0), np.array((0.0, 0.0, 1.0))
    thing = random.uniform((-0.2, -0.5, 0.0), (0.2, 0.5, 1.0), (3000, 3))
    ground = random.uniform((-3, -3, -1.2), (3, 3, -0.1), (40_000, 3))
    assert not mirrored_under(thing, ground, up, 0.0).any()
    image = thing * (1, 1, -1)
    flags = mirrored_under(thing, image, up, 0.0)
    assert flags[image[:, 2] < -0.1].all()


def test_what_stands_on_a_thing_is_left_on_it_when_that_is_gone():
    set_ = stage("table")
    made, names = set_.gaussians(8000), [each.name for each in set_.things]
    surfaces = look(made.scene, set_.training(96))
    left = partial(left_on, surfaces, segment_surfaces(surfaces))
    assert left(made.of("wooden table"))[made.of(*names).numpy()].mean() > 0.8
    assert not left(made.of(names[0])).any()


def boxed(low: tuple[float, ...], high: tuple[float, ...], count: int = 1500) -> np.ndarray:
    """Points in a box."""
    return np.random.default_rng(0).uniform(low, high, (count, 3))


@pytest.mark.parametrize(
    ("left", "goes"),
    [
        (boxed((-0.9, -0.05, 0.03), (0.9, 0.05, 0.1)), True),  # a beam from leg to leg
        (boxed((-0.9, -0.05, 0.03), (2.5, 0.05, 0.1)), False),  # it goes on beside the table
        (boxed((-0.3, -0.3, 0.03), (0.3, 0.3, 0.1)), False),  # a stone that no leg touches
        (boxed((-0.9, -0.05, 0.03), (0.9, 0.05, 0.9)), False),  # a wall: most of it is high
    ],
)
def test_what_a_selection_missed_between_the_feet_goes_along(left, goes):
    top = boxed((-1, -1, 1), (1, 1, 1.1), 6000)
    legs = [boxed((x - 0.05, -0.05, 0), (x + 0.05, 0.05, 1)) for x in (-0.9, 0.9)]
    table = np.concatenate((top, *legs))
    found = between_feet(table, left, Plane(np.array((0.0, 0.0, 1.0)), 0.0, 0.02))
    assert (found.mean() > 0.9) == goes
    assert goes or not found.any()


def test_crossed_beams_under_legs_go_along_and_are_no_support():
    top = boxed((-1, -1, 1), (1, 1, 1.1), 6000)
    feet = ((-0.9, 0), (0.9, 0), (0, -0.9), (0, 0.9))
    legs = [boxed((x - 0.05, y - 0.05, 0.2), (x + 0.05, y + 0.05, 1), 40) for x, y in feet]
    ends = ((-0.9, -0.06, 0.03), (0.9, 0.06, 0.15)), ((-0.06, -0.9, 0.03), (0.06, 0.9, 0.15))
    table, beams = np.concatenate((top, *legs)), np.concatenate([boxed(*each) for each in ends])
    ground = boxed((-3, -3, -0.01), (3, 3, 0.01), 40_000)
    found = between_feet(table, beams, Plane(np.array((0.0, 0.0, 1.0)), 0.0, 0.02))
    assert found.mean() > 0.9
    points = np.concatenate((table, beams, ground))
    object_ = np.arange(len(points)) < len(table)
    seen = (points[:, 2] < 0.02) | (points[:, 2] > 0.13)  # no view shows the inside of beams
    support = find_support(points, object_, seen.astype(float), np.array((0.0, 0.0, 1.0)))
    assert support is not None
    assert abs(support.offset) < 0.02


@pytest.mark.parametrize("name", ["pedestal", "meadow"])
def test_what_a_mask_missed_of_an_object_is_found(name):
    each = case(name)
    x = each.scene.means[:, 0]
    chosen = each.inside & (x < x[each.inside].quantile(0.67))
    surfaces = look(each.scene, each.cameras)
    lacking = partial(missed, surfaces, segment_surfaces(surfaces))
    found = torch.from_numpy(lacking(chosen))
    left = each.inside & ~chosen
    assert found[left].float().mean() > 0.8
    assert (found & ~each.inside).sum() < 0.1 * left.sum()
    assert not lacking(each.inside & (x > x[left].min())).any()


def test_what_carries_a_thing_stays():
    figure = boxed((-1, -1, 0.3), (1, 1, 2), 6000)
    block = boxed((-0.5, -0.5, 0.03), (0.5, 0.5, 0.29))
    assert not between_feet(figure, block, Plane(np.array((0.0, 0.0, 1.0)), 0.0, 0.02)).any()


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda s, i: (s, i & False), "nothing is selected"),
        (lambda s, i: (s, i | True), "whole scene"),
        (lambda s, i: (s, i[:-1]), "flags"),
    ],
)
def test_requests_that_cannot_be_met_are_refused_in_one_line(change, says):
    scene, inside, cameras = floating()
    scene, inside = change(scene, inside)
    with pytest.raises(UsageError, match=says) as refused:
        remove(scene, inside, cameras)
    assert "\n" not in str(refused.value)
