"""Placing: laws of standing, of what stays, of light, and refusals; on a ball on a meadow."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from bench.staged import stage
from plain_scenes import cloud, same_bits

from gsedit.change.objects import Placement, RelativePlace, insert, place, remove
from gsedit.change.objects.placing.daylight import Daylight, Sun, shaded, sun_of
from gsedit.change.objects.placing.insert import main_object
from gsedit.change.objects.placing.stance import stance_of
from gsedit.errors import UsageError
from gsedit.scene.cache import SceneCache
from gsedit.scene.outcome import NEW, same
from gsedit.scene.similarity import IDENTITY
from gsedit.scene.table import gaussians_of, table_of
from gsedit.select.region import Region, coverage
from gsedit.views.place import place_of
from rasterizer.numerics import sh_to_color
from rasterizer.render import render

HEIGHT = 0.54
"""Diameter of the ball, world units."""
UP = torch.tensor((0.0, 0.0, 1.0), dtype=torch.float64)
SECOND = torch.tensor((0.0, 1.0, 0.0))


@pytest.fixture(scope="module")
def meadow():
    """A red ball and a blue post on grass, under a sun from the front right."""
    return stage("meadow")


@pytest.fixture(scope="module")
def labelled(meadow):
    made = meadow.gaussians(2000)
    with SceneCache(made.scene).used():
        yield made


@pytest.fixture(scope="module")
def ball(labelled):
    return labelled.of("red ball")


@pytest.fixture(scope="module")
def cameras(meadow):
    return meadow.training(48)[::6]


@pytest.fixture(scope="module")
def ground(meadow):
    """Exact height of the grass."""
    return float(meadow.thing("red ball").foot[2])


@pytest.fixture(scope="module")
def right(labelled, ball, cameras):
    """The ball moved by its own size to the right."""
    return place(labelled.scene, ball, Placement(offset=(1.0, 0.0, 0.0)), cameras)


def of(outcome, inside):
    """The means of an object after an operation that moved it."""
    rows = inside.nonzero().squeeze(-1)
    order = torch.argsort(outcome.origin[torch.isin(outcome.origin, rows)])
    return outcome.scene.means[torch.isin(outcome.origin, rows)][order].double()


def test_nothing_asked_changes_nothing(labelled, ball, cameras):
    outcome = place(labelled.scene, ball, Placement(turn=720), cameras)
    assert outcome.scene is labelled.scene
    assert not outcome.changed.any()


def test_what_is_scaled_stays_standing(labelled, ball, cameras, ground):
    outcome = place(labelled.scene, ball, Placement(scale=2.0), cameras)
    before = labelled.scene.means[ball].double()
    over = of(outcome, ball)[:, 2] - ground
    assert (over - 2 * (before[:, 2] - ground)).abs().max() < 0.01 * HEIGHT


def test_what_is_turned_keeps_its_heights_and_distances(labelled, ball, cameras):
    outcome = place(labelled.scene, ball, Placement(turn=90), cameras)
    before, after = labelled.scene.means[ball].double(), of(outcome, ball)
    assert (after[:, 2] - before[:, 2]).abs().max() < 0.01 * HEIGHT
    middle = before.mean(0), after.mean(0)
    assert (middle[0] - middle[1]).norm() < 0.05 * HEIGHT
    quarter = torch.tensor(((0.0, -1.0), (1.0, 0.0)), dtype=torch.float64)
    turned = (before - middle[0])[:, :2] @ quarter.T
    assert (turned - (after - middle[1])[:, :2]).abs().max() < 0.02 * HEIGHT


def test_what_is_moved_stands_on_the_ground_at_its_new_place(labelled, ball, cameras, right):
    before, after = labelled.scene.means[ball].double(), of(right, ball)
    way = (after - before).mean(0)
    assert (after - before - way).abs().max() < 0.01 * HEIGHT
    assert abs(float(way[2])) < 0.01 * HEIGHT
    assert float(way.norm()) == pytest.approx(HEIGHT, rel=0.2)
    xy, _ = cameras[0].project(torch.stack((before.mean(0), after.mean(0))))
    assert float(xy[1, 0]) > float(xy[0, 0])


def test_back_again_is_where_it_was(labelled, ball, cameras, right):
    inside = torch.isin(right.origin, ball.nonzero().squeeze(-1))
    back = place(right.scene, inside, Placement(offset=(-1.0, 0.0, 0.0)), cameras)
    after = right.then(back)
    assert (of(after, ball) - labelled.scene.means[ball]).abs().max() < 0.04 * HEIGHT


def test_selection_with_slips_moves_each_gaussian_once(labelled, ball, cameras):
    slips = torch.rand(len(ball), generator=torch.Generator().manual_seed(0))
    asked = ball ^ (slips < 0.02)
    outcome = place(labelled.scene, asked, Placement(scale=1.2), cameras)
    rows = outcome.origin[outcome.origin != NEW]
    assert len(rows.unique()) == len(rows)
    assert not outcome.dropped(len(ball))[ball].any()
    gone = remove(labelled.scene, asked, cameras).dropped(len(ball))
    assert torch.equal(outcome.dropped(len(ball)) | ball, gone | ball)


def test_what_is_not_flagged_keeps_its_bits(labelled, right):
    kept = ~right.changed
    assert kept.any()
    assert same_bits(right.scene[kept], labelled.scene[right.origin[kept]])


def test_only_colors_change_outside(labelled, ball, cameras):
    outcome = place(labelled.scene, ball, Placement(to=RelativePlace("left"), copy=True), cameras)
    count = len(labelled.scene)
    assert torch.equal(outcome.scene.means[:count], labelled.scene.means)
    assert (outcome.origin[count:] == NEW).all()
    assert outcome.changed[count:].all()
    assert len(outcome.scene) == count + int(ball.sum())
    gap = (outcome.scene.means[count:].mean(0) - labelled.scene.means[ball].mean(0)).norm()
    assert float(gap) > HEIGHT


def test_copy_beside_is_seen_well_by_most_cameras(meadow, labelled, ball):
    cameras = [each.fitted(128) for each in meadow.training(32)]
    outcome = place(labelled.scene, ball, Placement(to=RelativePlace(), copy=True), cameras)
    copy = torch.arange(len(outcome.scene)) >= len(labelled.scene)
    shown = [coverage(Region(copy), outcome.scene, camera).sum() for camera in cameras]
    alone = [render(outcome.scene[copy], camera).alpha.sum() for camera in cameras]
    well = [float(part / all_of_it) > 0.78 for part, all_of_it in zip(shown, alone)]
    assert sum(well) >= 0.8 * len(cameras)


def test_it_goes_down_no_farther_than_to_what_carries_it(labelled, ball, cameras, ground):
    down = Placement(offset=(0, 0, -0.5))
    outcome = place(labelled.scene, ball, down, cameras)
    assert not outcome.changed.any()
    assert any("rests" in note for note in outcome.notes)
    lifted = labelled.scene.means.clone()
    lifted[ball] += torch.tensor((0.0, 0.0, 0.2))
    outcome = place(replace(labelled.scene, means=lifted), ball, down, cameras)
    over = of(outcome, ball)[:, 2].min() - labelled.scene.means[ball, 2].min()
    assert abs(float(over)) < 0.1 * HEIGHT


def test_a_whole_scene_is_scaled_and_turned_but_goes_nowhere(labelled, cameras):
    scene, whole = labelled.scene, torch.ones(len(labelled.scene), dtype=torch.bool)
    outcome = place(scene, whole, Placement(scale=0.5, turn=90), cameras)
    before, after = (torch.pdist(each.means[::200]) for each in (scene, outcome.scene))
    assert torch.allclose(after, before / 2, rtol=1e-3, atol=1e-4)
    assert outcome.changed.all()
    with pytest.raises(UsageError, match="whole scene"):
        place(scene, whole, Placement(offset=(1.0, 0.0, 0.0)), cameras)


@pytest.fixture(scope="module")
def pedestal():
    """A statue on a pedestal that has no room for a second one; its cameras."""
    made = stage("pedestal")
    return made.gaussians(1700), made.training(32)[::5]


def test_copy_beside_stands_whole_on_what_it_finds(pedestal):
    labelled, cameras = pedestal
    statue, scene = labelled.of("orange statue"), labelled.scene
    for side in ("left", "beside"):
        outcome = place(scene, statue, Placement(to=RelativePlace(side), copy=True), cameras)
        assert not any("over the edge" in note or "reaches" in note for note in outcome.notes)
        assert any("from where it stood" in note for note in outcome.notes)


def test_on_the_table_is_where_nothing_stands(pedestal):
    labelled, cameras = pedestal
    scene, floor = labelled.scene, labelled.of("tiled floor")
    small = Placement(0.5, to=RelativePlace("on", floor), copy=True)
    outcome = place(scene, labelled.of("orange statue"), small, cameras)
    copy = outcome.scene.means[len(scene) :]
    assert float(copy[:, 2].min()) == pytest.approx(-0.45, abs=0.05)
    assert copy[:, :2].abs().amax(1).min() > 0.3


def test_sun_is_told_from_shadows(meadow, labelled, ball, cameras):
    body, rest = labelled.scene[ball], labelled.scene[~ball]
    stance = stance_of(body, rest, UP)
    assert stance.stands
    found = sun_of(labelled.scene, stance)
    assert found is not None
    true = torch.nn.functional.normalize(torch.tensor(meadow.light.sun).double(), dim=0)
    assert math.degrees(math.acos(float(found.direction @ true))) < 12
    even = replace(labelled.scene, sh=torch.full_like(labelled.scene.sh, 0.3))
    assert sun_of(even, stance) is None


def test_shadow_is_under_what_casts_it(labelled, ball, cameras):
    body, rest = labelled.scene[ball], labelled.scene[~ball]
    stance = stance_of(body, rest, UP)
    light = Daylight(place_of(rest, cameras), Sun(UP, torch.full((3,), 2.0).double()))
    there = replace(body, means=body.means + torch.tensor((0.8, 0.0, 0.0)))
    stance = replace(stance, foot=stance.foot + torch.tensor((0.8, 0.0, 0.0)))
    after = shaded(same(rest), there, stance, light)
    brighter = (sh_to_color(after.scene.sh[:, 0]) - sh_to_color(rest.sh[:, 0])).mean(-1)
    away = (rest.means - stance.foot)[:, :2].norm(dim=-1)
    level = (rest.means[:, 2] - stance.foot[2]).abs() < 0.06
    assert float(brighter[level & (away < 0.2)].mean()) < -0.05
    assert float(brighter.max()) < 1e-6
    assert not after.changed[away > 4 * HEIGHT].any()


def lone_statue(factor=1.0):
    """A tall ellipsoid of Gaussians, upright along -y, as captures often are."""
    random = np.random.default_rng(3)
    points = random.normal(size=(400, 3))
    points = points / np.linalg.norm(points, axis=1, keepdims=True) * (0.2, 0.5, 0.2)
    scene = cloud(torch.tensor(points), math.log(0.015), 0.53)
    scene = replace(scene, sh=scene.sh.repeat(1, 9, 1))
    return gaussians_of(replace(IDENTITY, scale=factor).table(table_of(scene)))


def test_inserted_scale_does_not_matter(labelled, ball, cameras, ground):
    at = RelativePlace("left", ball)
    once, again = (
        insert(labelled.scene, lone_statue(f), at, cameras, up=-SECOND) for f in (1.0, 1000.0)
    )
    count = len(labelled.scene)
    one, two = (each.scene.means[count:] for each in (once, again))
    assert (one - two).abs().max() < 0.02 * HEIGHT
    assert once.scene.sh.shape[1] == labelled.scene.sh.shape[1]
    assert any("fitted" in note for note in again.notes)
    height = float(one[:, 2].max() - one[:, 2].min())
    assert height == pytest.approx(HEIGHT, rel=0.25)
    assert abs(float(one[:, 2].min()) - ground) < 0.1 * HEIGHT


def test_ground_of_another_scene_is_left_out(labelled):
    found = main_object(labelled.scene, UP)
    things = ~labelled.of("grass")
    assert (found & ~things).sum() < 0.02 * things.sum()
    assert (found & things).sum() > 0.5 * things.sum()


@pytest.mark.parametrize(
    ("inside", "placement"),
    [
        (False, Placement(scale=2)),
        (True, Placement(to=(1.0, 0.0, 0.0))),
        (None, Placement(scale=0)),
        (None, Placement(scale=float("nan"))),
        (None, Placement(turn=float("inf"))),
        (None, Placement(to=(0.0, float("nan"), 0.0))),
        (None, Placement(to=RelativePlace("left", torch.zeros(3, dtype=torch.bool)))),
    ],
)
def test_what_cannot_be_placed_is_refused_in_a_line(labelled, ball, cameras, inside, placement):
    flags = ball if inside is None else torch.full_like(ball, inside)
    with pytest.raises(UsageError) as refusal:
        place(labelled.scene, flags, placement, cameras)
    assert "\n" not in str(refusal.value)
