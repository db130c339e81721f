"""Growth: it lies where it should, stands out at the side, and leaves the rest as it was."""

from functools import cache

import pytest
import torch
from bench.staged import stage as stage_of
from plain_scenes import all_finite, discs, same_bits

from gsedit.bench.synthetic.paint import plain
from gsedit.bench.synthetic.scene import SyntheticScene
from gsedit.bench.synthetic.shapes import cylinder, sphere, translate, union
from gsedit.bench.synthetic.splats import surface_gaussians
from gsedit.change.objects.growth.grow import LEAF, MOST_NEW, blanket, grow
from gsedit.change.objects.growth.places import GROWTHS
from gsedit.errors import UsageError
from gsedit.scene.outcome import NEW
from gsedit.views.orbit import orbit
from rasterizer.camera import look_at
from rasterizer.render import render
from rasterizer.scene import concatenate

UP = torch.tensor((0.0, 0.0, 1.0), dtype=torch.float64)
BALL, TABLE, FLOOR = 0.35, 0.28, -0.55


@cache
def stage():
    """A ball on a table with one leg, on a wide floor; z is up."""
    solids = union(
        sphere(BALL, (0.0, 0.0, TABLE + BALL)),
        translate(cylinder(0.6, 0.05, 0.02), (0, 0, TABLE - 0.05)),
        translate(cylinder(0.08, 0.4), (0, 0, -0.15)),
        translate(cylinder(1.3, 0.05, 0.02), (0, 0, FLOOR - 0.05)),
    )
    gray, sky = plain((0.5, 0.45, 0.4)), torch.tensor((0.8, 0.9, 1.0))
    scene = SyntheticScene("stage", solids, gray, sky, 1.5, UP)
    return surface_gaussians(scene, 3500, torch.Generator().manual_seed(0))


@cache
def cameras():
    return orbit(stage(), 8, 96, up=UP, elevation=25.0)


@cache
def grown(name, amount=1.0):
    everything = torch.ones(len(stage()), dtype=torch.bool)  # None brings overcast light too
    return grow(stage(), name, amount, everything, cameras())


def added(outcome):
    return outcome.scene[outcome.origin == NEW]


def view(eye, middle=(0.0, 0.0, 0.0), up=(0.0, 0.0, 1.0)):
    eye, middle, up = (torch.tensor(each, dtype=torch.float64) for each in (eye, middle, up))
    return look_at(eye, middle, up, 40.0, 128, 128)


@pytest.mark.parametrize("name", list(GROWTHS))
def test_rows_keep_their_places_and_what_is_not_changed_its_bits(name):
    scene, after = stage(), grown(name)
    count = len(scene)
    assert after.origin[:count].tolist() == list(range(count))
    assert bool((after.origin[count:] == NEW).all())
    assert bool(after.changed[count:].all())
    assert 0 < len(after.scene) - count <= MOST_NEW
    assert f"{len(after.scene) - count:,} Gaussians were added" in after.notes[0]
    kept = ~after.changed[:count]
    old, bands = after.scene[:count], scene.sh.shape[1]
    assert same_bits(old, scene, but=("sh",))
    assert not old.sh[kept, bands:].any()
    assert torch.equal(old.sh[kept, :bands], scene.sh[kept])
    assert all_finite(after.scene)
    assert same_bits(grown.__wrapped__(name).scene, after.scene)


def test_snow_stands_out_at_the_side_and_more_of_it_the_more():
    side = view((0.0, -4.0, TABLE + 2 * BALL), (0.0, 0.0, TABLE + 2 * BALL))
    band = slice(64 - 12, 64 - 2)  # rows of pixels just over the top of the ball

    def alpha(scene):
        return float(render(scene, side).alpha[band, 54:74].mean())

    before, usual, thick = (alpha(each) for each in (
        stage(), grown("snow").scene, grown("snow", 2.0).scene
    ))  # fmt: skip
    assert usual > before + 0.03
    assert thick > usual + 0.1


def rough_ground():
    """Level ground of uneven Gaussians with many small holes, and a block on it."""
    random = torch.Generator().manual_seed(0)
    spots = 2 * torch.rand(20_000, 2, generator=random) - 1
    on = (spots.abs() < 0.25).all(1)
    rough = 0.01 * torch.randn(len(spots), generator=random)
    means = torch.cat((spots, (0.2 * on + rough)[:, None]), 1)
    gaps = torch.rand(150, 2, generator=random) * 2 - 1
    means = means[(spots[:, None] - gaps).norm(dim=-1).amin(1) > 0.03]
    return discs(means, torch.tensor((0.0, 0.0, 1.0)).expand_as(means), 0.012)


def test_snow_is_one_blanket_on_ground_full_of_holes_up_to_what_stands_on_it():
    scene = rough_ground()
    everything = torch.ones(len(scene), dtype=torch.bool)
    around = orbit(scene, 8, 96, up=UP, elevation=40.0)
    new = added(grow(scene, "snow", 2.0, everything, around))
    eye = view((0.0, -0.01, 4.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    alpha = render(new, eye).alpha[40:88, 40:88]
    assert float((alpha > 0.9).double().mean()) > 0.94


def test_a_blanket_is_round_at_an_edge_and_full_at_the_foot_of_a_wall():
    heights = torch.zeros(40, 60, dtype=torch.float64)
    heights[:, 20:], heights[:, 40:] = 5.0, 20.0
    thick = blanket(heights + 1.0, 6, 1.0) - heights
    assert torch.allclose(thick[:, 38], torch.ones(40).double())  # at the foot
    assert (thick[:, 20] < 0.3).all()  # at the brink
    assert (thick[:, 20:27].diff(dim=1) > -1e-9).all()


@pytest.mark.parametrize(
    ("name", "whole", "lowest", "bare"),
    [("snow", 0.6, 0.4, -0.3), ("dust", 0.5, 0.3, -0.4), ("moss", -0.4, -0.65, -0.7)],
)
def test_it_covers_a_ball_in_one_piece_down_to_where_it_turns_away(name, whole, lowest, bare):
    scene, after, middle = stage(), grown(name), torch.tensor((0.0, 0.0, TABLE + BALL))
    new = added(after).means
    away, size = new - middle, (new - middle).norm(dim=1)
    near = (size < BALL + 0.12) & (away[:, 2] > -0.2)
    assert float((away[near, 2] / size[near]).amin()) > lowest
    size = (scene.means - middle).norm(dim=1)
    rise = ((scene.means - middle)[:, 2] / size).masked_fill(size > BALL + 0.02, torch.nan)
    assert not after.changed[: len(scene)][(rise < bare) & (rise > -0.8)].any()
    assert float(torch.cdist(scene.means[rise > whole], new).amin(1).quantile(0.95)) < 0.08
    x, y, z = new.T  # under the table only moss grows, on its leg
    assert bool(((torch.hypot(x, y) < 0.3) & (z < TABLE - 0.1)).any()) == (name == "moss")


def test_moss_is_on_ground_more_than_among_petals():
    ground, random = rough_ground(), torch.Generator().manual_seed(1)
    petals, ways = torch.randn(2, 1500, 3, generator=random)
    petals = 0.1 * petals + torch.tensor((0.6, 0.6, 0.4))
    scene = concatenate(ground, discs(petals, torch.nn.functional.normalize(ways, dim=1), 0.02))
    everything = torch.ones(len(scene), dtype=torch.bool)
    after = grow(scene, "moss", 1.0, everything, orbit(scene, 8, 96, up=UP, elevation=40.0))
    mossy = after.changed[: len(scene)].double()
    assert float(mossy[len(ground) :].mean()) < 0.5 * float(mossy[: len(ground)].mean())


def test_fallen_leaves_lie_on_what_is_level():
    x, y, z = added(grown("leaves")).means.reshape(-1, len(LEAF), 3).mean(1).T
    rest = torch.where(torch.hypot(x, y) < 0.61, TABLE, FLOOR)
    lies = ((z - rest).abs() < 0.12) | (z > TABLE + 1.75 * BALL)
    assert float(lies.double().mean()) > 0.955


def test_far_ground_gets_snow_and_floaters_beside_it_do_not():
    random = torch.rand(3000, 3, generator=torch.Generator().manual_seed(0))
    ground = random * torch.tensor((2.0, 3.0, 0.0)) + torch.tensor((-5.0, -1.5, FLOOR))
    leaves = random[:400] + torch.tensor((3.5, -0.5, FLOOR))
    up = torch.tensor((0.0, 0.0, 1.0)).expand(3000, 3)
    scene = concatenate(stage(), discs(ground, up, 0.05), discs(leaves, up[:400], 0.05))
    x = added(grow(scene, "snow", 1.0, None, cameras())).means[:, 0]
    assert (x < -3.2).sum() > 100
    assert not (x > 3.2).any()


def test_snow_is_darker_where_it_turns_from_the_sun():
    staged = stage_of("meadow")
    given = staged.gaussians(3000)
    after = grow(given.scene, "snow", 1.0, given.of("red ball"), staged.training(48))
    new = added(after)
    sun = torch.tensor(staged.light.sun).double()
    towards = (new.means.double() - new.means.double().mean(0)) @ sun
    low, high = towards.quantile(torch.tensor((0.25, 0.75)).double())
    lit, dark = new.sh[towards > high, 0].mean(), new.sh[towards < low, 0].mean()
    assert float(lit) > float(dark) + 0.3


def test_only_the_part_gets_any():
    scene = stage()
    floor = scene.means[:, 2] < FLOOR + 0.05
    after = grow(scene, "snow", 1.0, floor, cameras())
    assert float(added(after).means[:, 2].max()) < FLOOR + 0.3
    assert not after.changed[: len(scene)][~floor].any()


@pytest.mark.parametrize(
    ("name", "amount", "message"),
    [("sand", 1.0, "there is no growth 'sand'"), ("snow", 50.0, "out of range"),
     ("snow", float("nan"), "out of range")],
)  # fmt: skip
def test_what_there_is_not_is_refused(name, amount, message):
    with pytest.raises(UsageError, match=message):
        grow(stage(), name, amount)


def test_where_it_can_lie_nowhere_it_is_refused():
    scene = stage()
    x, y, z = scene.means.T
    leg = (torch.hypot(x, y) < 0.1) & (z < 0.1) & (z > FLOOR + 0.1)
    for inside in (leg, torch.zeros(len(scene), dtype=torch.bool)):
        with pytest.raises(UsageError, match="snow lies nowhere: nothing inside faces up"):
            grow(scene, "snow", 1.0, inside, cameras())
