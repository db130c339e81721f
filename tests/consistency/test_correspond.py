"""Correspondences against geometry whose depth is a formula."""

import math
from dataclasses import replace
from itertools import combinations

import pytest
import torch
from matching import match
from walls import (
    BALL,
    CELL,
    FOUR,
    FRONTAL,
    SLANTED,
    UP,
    camera,
    centers,
    clusters,
    occluded_depth,
    plane_depth,
    seen,
    sphere_depth,
    stacked,
    true_error,
)

from gsedit.errors import UsageError
from gsedit.paper.consistency.correspond import correspond
from gsedit.views.depth_maps import Visibility
from rasterizer import look_at

# ---- matching ------------------------------------------------------------------------------------


@pytest.mark.parametrize("cell", [1, 3, 4, 8, 16])
def test_a_view_matches_itself_cell_by_cell(cell):
    view = seen(camera(0.4, size=48))
    pairs = match(*view, *view, cell=cell)
    assert torch.equal(pairs.a, torch.arange((48 // cell) ** 2))
    assert torch.equal(pairs.b, pairs.a)
    assert pairs.error.max() < 1e-9  # float64 there and back


def test_a_shift_by_whole_cells_along_a_wall_is_found_exactly():
    a = look_at(torch.zeros(3), torch.tensor([0.0, 0.0, 4.0]), UP, 40.0, 128, 128)
    step = 2 * CELL * 4.0 / a.fx  # two cells at depth 4
    pose = a.world_to_camera.clone()
    pose[0, 3] -= step
    b = replace(a, world_to_camera=pose)
    pairs = match(*seen(a, plane_depth(a, FRONTAL)), *seen(b, plane_depth(b, FRONTAL)), cell=CELL)
    assert len(pairs.a) == 16 * 14
    assert torch.equal(pairs.a // 16, pairs.b // 16)
    assert torch.equal(pairs.a % 16 - pairs.b % 16, torch.full_like(pairs.a, 2))


@pytest.mark.parametrize(
    "depth_of", [lambda c, xy=None: plane_depth(c, SLANTED, xy), occluded_depth]
)
def test_accepted_pairs_are_within_half_a_cell_of_the_truth(depth_of):
    errors = []
    for a, b in combinations(FOUR, 2):
        pairs = match(*seen(a, depth_of(a)), *seen(b, depth_of(b)), cell=CELL)
        assert len(pairs.a) > 0.3 * 256  # a rule that accepts nothing is never wrong
        errors.append(true_error(a, b, pairs, depth_of))
    errors = torch.cat(errors)
    # exact on the wall; on the ball the depth between pixels is interpolated, so rounding may tip
    assert (errors <= 0.5 + 1e-9).double().mean() >= 0.99
    assert errors.max() < 0.55


def test_no_pair_across_an_occlusion():
    hidden = 0
    for a, b in combinations(FOUR, 2):
        pairs = match(*seen(a, occluded_depth(a)), *seen(b, occluded_depth(b)), cell=CELL)
        for one, other, index in ((a, b, pairs.a), (b, a, pairs.b)):
            xy = centers(one, index)
            true, z = other.project(one.unproject(xy, occluded_depth(one, xy)))
            visible = (z - occluded_depth(other, true)).abs() < 0.01 * z
            assert visible.all()
        wall = centers(a, torch.arange(256))
        true, z = b.project(a.unproject(wall, plane_depth(a, SLANTED, wall)))
        hidden += int((z > 1.01 * sphere_depth(b, *BALL, true)).sum())
    assert hidden > 50  # the ball does hide something


def test_match_is_symmetric():
    a, b = (seen(c, occluded_depth(c)) for c in FOUR[:2])
    there, back = match(*a, *b, cell=CELL), match(*b, *a, cell=CELL)
    order = back.b.argsort()
    assert torch.equal(there.a, back.b[order])
    assert torch.equal(there.b, back.a[order])
    torch.testing.assert_close(there.error, back.error[order], atol=0, rtol=0)


def test_moving_the_world_moves_nothing():
    turn = torch.linalg.qr(torch.randn(3, 3, generator=torch.Generator().manual_seed(0)).double())[
        0
    ]
    move = torch.eye(4, dtype=torch.float64)
    move[:3, :3], move[:3, 3] = turn * turn.det(), torch.tensor([1.0, -2.0, 0.5])
    a, b = FOUR[:2]
    moved = [replace(c, world_to_camera=c.world_to_camera @ move) for c in (a, b)]
    depths = [occluded_depth(c) for c in (a, b)]
    expected = match(*seen(a, depths[0]), *seen(b, depths[1]), cell=CELL)
    found = match(*seen(moved[0], depths[0]), *seen(moved[1], depths[1]), cell=CELL)
    assert torch.equal(found.a, expected.a)
    assert torch.equal(found.b, expected.b)


def test_views_of_different_sizes_match():
    a, b = camera(-0.3), camera(0.3, size=192)
    pairs = match(*seen(a), *seen(b), cell=CELL)
    assert len(pairs.a) > 100
    assert true_error(a, b, pairs, lambda c, xy: plane_depth(c, SLANTED, xy)).max() <= 0.5 + 1e-9


def test_each_rule_refuses_what_it_is_for():
    a, b = camera(-0.2), camera(0.2)
    plain = len(match(*seen(a), *seen(b), cell=CELL).a)
    depth, glass = plane_depth(a, SLANTED), torch.ones(128, 128)
    glass[:, :64] = 0.5
    assert len(match(a, depth, glass, *seen(b), cell=CELL).a) < 0.7 * plain
    assert len(match(a, depth * 1.05, torch.ones(128, 128), *seen(b), cell=CELL).a) == 0
    nothing = match(a, 0 * depth, torch.ones(128, 128), *seen(b), cell=CELL)
    assert len(nothing.a) == 0
    poisoned = depth.clone()
    poisoned[0, 0], poisoned[60, 60], poisoned[127, 127] = torch.nan, torch.inf, -1.0
    assert 0 < plain - len(match(a, poisoned, torch.ones(128, 128), *seen(b), cell=CELL).a) <= 3 * 4
    behind = look_at(torch.zeros(3), torch.tensor([0.0, 0.0, -4.0]), UP, 40.0, 128, 128)
    assert len(match(*seen(a), *seen(behind, torch.full((128, 128), 4.0)), cell=CELL).a) == 0
    closer = camera(0.0, z=2.5)
    far, near = (seen(c, plane_depth(c, FRONTAL)) for c in (camera(0.0), closer))
    assert len(match(*far, *near, cell=CELL).a) == 0
    assert len(match(*far, *near, cell=CELL, rules=Visibility(footprint=3.0)).a) > 20


def test_the_round_trip_is_the_error_of_depth_as_it_shows_in_the_picture():
    """Depth that is wrong by 0.8 % passes for agreement; 44 degrees apart it is a pixel."""
    a, b = camera(-1.6), camera(1.6)
    wrong = (b, 1.008 * plane_depth(b, FRONTAL), torch.ones(128, 128))
    right = seen(a, plane_depth(a, FRONTAL))
    assert len(match(*right, *wrong, cell=CELL).a) > 100  # an eighth of a cell
    assert len(match(*right, *wrong, cell=1).a) == 0  # a whole one
    loose = match(*right, *wrong, cell=1, rules=Visibility(round_trip=2.0))
    assert len(loose.a) > 100  # few are mutual


def round_the_wall(degrees):
    """A camera at distance 4 from the middle of the frontal wall, `degrees` from its normal."""
    angle = math.radians(degrees)
    origin = torch.tensor([4 * math.sin(angle), 0.0, 4 - 4 * math.cos(angle)])
    view = look_at(origin, torch.tensor([0.0, 0.0, 4.0]), UP, 20.0, 128, 128)
    return seen(view, plane_depth(view, FRONTAL))


def test_a_slanted_cell_holds_several_frontal_ones():
    frontal, slanted = round_the_wall(0), round_the_wall(75)  # cos 75 = 0.26
    wide = Visibility(angle=90.0)
    assert len(match(*frontal, *slanted, cell=CELL, rules=wide).a) == 0
    assert len(match(*slanted, *frontal, cell=CELL, rules=wide).a) == 0
    assert len(match(*frontal, *slanted, cell=CELL, rules=replace(wide, footprint=6.0)).a) > 20
    assert len(match(*frontal, *round_the_wall(50), cell=CELL).a) > 100  # cos 50 = 0.64


def test_views_from_far_apart_do_not_match_though_no_cell_is_stretched():
    left, right = round_the_wall(-35), round_the_wall(35)
    assert len(match(*left, *right, cell=CELL).a) == 0
    assert len(match(*left, *right, cell=CELL, rules=Visibility(angle=80.0)).a) > 50
    assert len(match(*round_the_wall(-25), *round_the_wall(25), cell=CELL).a) > 100


def test_a_wall_seen_from_behind_does_not_match():
    front, back = round_the_wall(50), round_the_wall(130)
    assert len(match(*front, *back, cell=CELL, rules=Visibility(angle=180.0)).a) == 0


def test_a_silhouette_cell_is_never_matched():
    a, b = FOUR[1], FOUR[2]
    on_ball = sphere_depth(a, *BALL).isfinite().reshape(16, CELL, 16, CELL)
    torn = (on_ball.any(3).any(1) & ~on_ball.all(3).all(1)).flatten()
    pairs = match(*seen(a, occluded_depth(a)), *seen(b, occluded_depth(b)), cell=CELL)
    assert torn.sum() > 10
    assert not torn[pairs.a].any()


# ---- clusters ------------------------------------------------------------------------------------


def test_clusters_are_numbered_in_order_of_first_appearance():
    found = correspond(*stacked(FOUR), cell=CELL)
    inside = [n for n in found.labels.flatten().tolist() if n >= 0]
    assert list(dict.fromkeys(inside)) == list(range(found.count))


def test_the_order_of_views_only_permutes():
    order = [2, 0, 3, 1]
    plain = correspond(*stacked(FOUR), cell=CELL)
    mixed = correspond(*stacked([FOUR[i] for i in order]), cell=CELL)
    back = torch.empty_like(mixed.labels)
    back[order] = mixed.labels
    assert clusters(back) == clusters(plain.labels)
    torch.testing.assert_close(mixed.matched, plain.matched[order][:, order], atol=0, rtol=0)


def test_two_views_give_their_pairs_as_clusters():
    a, b = FOUR[:2]
    pairs = match(*seen(a, occluded_depth(a)), *seen(b, occluded_depth(b)), cell=CELL)
    found = correspond(*stacked([a, b]), cell=CELL)
    expected = {frozenset((i, 256 + j)) for i, j in zip(pairs.a.tolist(), pairs.b.tolist())}
    assert clusters(found.labels) == expected
    assert found.matched[0, 1] == found.matched[1, 0] == len(pairs.a) / 256
    assert found.covered.tolist() == [len(pairs.a) / 256] * 2


def test_clusters_are_what_the_greedy_loop_over_sets_says():
    _, depths, alphas = stacked(FOUR)
    links = []
    for a, b in combinations(range(4), 2):
        views = [FOUR[a], depths[a], alphas[a], FOUR[b], depths[b], alphas[b]]
        pairs = match(*views, cell=CELL)
        links += [(e, (a, i), (b, j)) for i, j, e in zip(*(p.tolist() for p in pairs))]
    group, refused = {cell: {cell} for _, *ends in links for cell in ends}, 0
    for _, one, other in sorted(links):
        merged = group[one] | group[other]
        if len({view for view, _ in merged}) < len(merged):
            refused += 1
        else:
            group.update(dict.fromkeys(merged, merged))
    expected = {frozenset(v * 256 + i for v, i in g) for g in group.values() if len(g) > 1}
    assert refused > 20
    assert clusters(correspond(FOUR, depths, alphas, cell=CELL).labels) == expected


def test_one_view_or_empty_depth_matches_nothing():
    alone = correspond(*stacked(FOUR[:1]), cell=CELL)
    assert alone.count == 0
    cameras, depths, alphas = stacked(FOUR)
    empty = correspond(cameras, 0 * depths, alphas, cell=CELL)
    assert empty.count == 0
    assert torch.equal(empty.matched, torch.eye(4).double())


@pytest.mark.parametrize(("views", "side"), [(8, 128), (3, 384)])
def test_many_views_and_large_ones_correspond_too(views, side):
    cameras = [camera(-0.8 + 0.2 * i, 0.1 * (i % 3), size=side) for i in range(views)]
    arguments = stacked(cameras)
    found = correspond(*arguments, cell=CELL)
    assert found.covered.mean() > 0.5


def test_pictures_that_do_not_fit_are_refused_with_the_next_move():
    cameras, depths, alphas = stacked(FOUR[:2])
    with pytest.raises(UsageError, match="multiples of 7"):
        correspond(cameras, depths, alphas, cell=7)
    with pytest.raises(UsageError, match="resize the camera"):
        correspond([c.resized(64, 64) for c in cameras], depths, alphas, cell=CELL)
