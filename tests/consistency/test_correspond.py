"""Correspondences against geometry whose depth is a formula; laws of consensus and noise."""

from dataclasses import replace
from itertools import combinations

import pytest
import torch

from gsedit.consistency.consensus import consensus, share_noise
from gsedit.consistency.correspond import Visibility, correspond, match, warp
from gsedit.errors import UsageError
from rasterizer.camera import look_at

CELL = 8
UP = torch.tensor([0.0, -1.0, 0.0])
FRONTAL = (torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64), 4.0)
"""A wall across the view: planes are (normal, offset), points with normal @ x = offset."""
SLANTED = (torch.tensor([0.6, 0.2, 1.0], dtype=torch.float64), 4.0)
"""The same wall turned by 32 degrees: depth, scale and rounding differ all over the picture."""


def camera(x, y=0.0, z=0.0, size=128):
    eye = torch.tensor([x, y, z])
    return look_at(eye, torch.tensor([0.0, 0.0, 4.0]), UP, 40.0, size, size)


def rays(view, xy):
    """World direction of depth 1 through each position, and the eye."""
    return view.unproject(xy, torch.ones_like(xy[..., 0])) - view.centre, view.centre


def plane_depth(view, plane, xy=None):
    normal, offset = plane
    direction, eye = rays(view, view.pixel_centres() if xy is None else xy)
    return (offset - eye @ normal) / (direction @ normal)


def sphere_depth(view, centre, radius, xy=None):
    """Inf where the ray misses."""
    direction, eye = rays(view, view.pixel_centres() if xy is None else xy)
    offset = eye - centre
    a, b = direction.square().sum(-1), direction @ offset
    root = b.square() - a * (offset @ offset - radius**2)
    return torch.where(root >= 0, (-b - root.clamp_min(0).sqrt()) / a, torch.inf)


BALL = (torch.tensor([0.1, 0.05, 2.6], dtype=torch.float64), 0.4)
"""In front of the wall: it hides different parts of it from each view."""


def occluded_depth(view, xy=None):
    return torch.minimum(plane_depth(view, SLANTED, xy), sphere_depth(view, *BALL, xy))


def seen(view, depth=None):
    depth = plane_depth(view, SLANTED) if depth is None else depth
    return view, depth, torch.ones_like(depth)


def centres(view, index):
    columns = view.width // CELL
    return torch.stack((index % columns, index // columns), -1).double() * CELL + CELL / 2


def true_error(a, b, pairs, depth_of):
    """Distance in cells, along either axis, from the matched cell's centre to the true position."""
    xy = centres(a, pairs.a)
    true, _ = b.project(a.unproject(xy, depth_of(a, xy)))
    return (true - centres(b, pairs.b)).abs().amax(-1) / CELL


def clusters(labels):
    """The partition that labels describe, whatever the clusters are called."""
    groups = {}
    for index, name in enumerate(labels.flatten().tolist()):
        if name >= 0:
            groups.setdefault(name, set()).add(index)
    return {frozenset(g) for g in groups.values()}


FOUR = [camera(x, y) for x, y in ((-0.7, 0.1), (-0.2, -0.25), (0.3, 0.2), (0.9, -0.1))]


def stacked(cameras, depth_of=occluded_depth):
    depths = torch.stack([depth_of(c) for c in cameras])
    return cameras, depths, torch.ones_like(depths)


# ---- matching ------------------------------------------------------------------------------------


def test_a_view_matches_itself_cell_by_cell():
    view = seen(camera(0.4))
    pairs = match(*view, *view, cell=CELL)
    assert torch.equal(pairs.a, torch.arange(256))
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
            xy = centres(one, index)
            true, z = other.project(one.unproject(xy, occluded_depth(one, xy)))
            visible = (z - occluded_depth(other, true)).abs() < 0.01 * z
            assert visible.all()
        wall = centres(a, torch.arange(256))
        true, z = b.project(a.unproject(wall, plane_depth(a, SLANTED, wall)))
        hidden += int((z > 1.01 * sphere_depth(b, *BALL, true)).sum())
    assert hidden > 50  # the exhibit does hide something


def test_match_is_symmetric():
    a, b = (seen(c, occluded_depth(c)) for c in FOUR[:2])
    there, back = match(*a, *b, cell=CELL), match(*b, *a, cell=CELL)
    order = back.b.argsort()
    assert torch.equal(there.a, back.b[order])
    assert torch.equal(there.b, back.a[order])
    torch.testing.assert_close(there.error, back.error[order], atol=0, rtol=0)


def test_each_cell_is_used_once():
    a, b = (seen(c, occluded_depth(c)) for c in FOUR[:2])
    pairs = match(*a, *b, cell=CELL)
    assert len(pairs.a.unique()) == len(pairs.a) == len(pairs.b.unique())


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


@pytest.mark.parametrize("cell", [1, 3, 4, 16])
def test_any_cell_size_has_its_centre_in_the_middle(cell):
    view = seen(camera(0.2, size=48))
    pairs = match(*view, *view, cell=cell)
    assert len(pairs.a) == (48 // cell) ** 2


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
    strict = match(*seen(a), *seen(b), cell=CELL, rules=Visibility(round_trip=0.2))
    assert 0 < len(strict.a) < plain
    assert strict.error.max() <= 0.2


def test_a_silhouette_cell_is_never_matched():
    a, b = FOUR[1], FOUR[2]
    on_ball = sphere_depth(a, *BALL).isfinite().reshape(16, CELL, 16, CELL)
    torn = (on_ball.any(3).any(1) & ~on_ball.all(3).all(1)).flatten()
    pairs = match(*seen(a, occluded_depth(a)), *seen(b, occluded_depth(b)), cell=CELL)
    assert torn.sum() > 10
    assert not torn[pairs.a].any()


# ---- clusters ------------------------------------------------------------------------------------


def test_clusters_hold_at_most_one_cell_a_view_and_at_least_two():
    labels = correspond(*stacked(FOUR), cell=CELL).labels
    for group in clusters(labels):
        views = [cell // 256 for cell in group]
        assert len(views) == len(set(views)) >= 2


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


def test_identical_views_form_one_cluster_a_cell():
    found = correspond(*stacked([FOUR[0]] * 3, lambda c: plane_depth(c, SLANTED)), cell=CELL)
    assert torch.equal(found.labels, torch.arange(256).reshape(1, 16, 16).expand(3, -1, -1))
    assert torch.equal(found.matched, torch.ones(3, 3).double())


def test_one_view_or_empty_depth_matches_nothing():
    alone = correspond(*stacked(FOUR[:1]), cell=CELL)
    assert alone.count == 0
    cameras, depths, alphas = stacked(FOUR)
    empty = correspond(cameras, 0 * depths, alphas, cell=CELL)
    assert empty.count == 0
    assert torch.equal(empty.matched, torch.eye(4).double())


@pytest.mark.parametrize(("views", "side"), [(8, 256), (4, 512)])
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


# ---- consensus and noise -------------------------------------------------------------------------


@pytest.fixture(scope="module")
def labels():
    return correspond(*stacked(FOUR), cell=CELL).labels


def draw(labels, seed=0, channels=4):
    generator = torch.Generator().manual_seed(seed)
    views, height, width = labels.shape
    return torch.randn(views, channels, height, width, dtype=torch.float64, generator=generator)


def naive_consensus(x, labels, anchored):
    out = x.clone()
    for name in range(int(labels.max()) + 1):
        cells = (labels == name).nonzero().tolist()
        leaders = [c for c in cells if anchored[c[0]]]
        mean = sum(x[v, :, i, j] for v, i, j in leaders or cells) / len(leaders or cells)
        for v, i, j in cells:
            if not anchored[v]:
                out[v, :, i, j] = mean
    return out


@pytest.mark.parametrize("anchors", [[], [1], [0, 2], [0, 1, 2, 3]])
def test_consensus_is_what_the_loop_says(labels, anchors):
    anchored = torch.zeros(4, dtype=torch.bool)
    anchored[anchors] = True
    x = draw(labels)
    found = consensus(x, labels, anchored=anchored)
    torch.testing.assert_close(found, naive_consensus(x, labels, anchored), atol=1e-14, rtol=0)
    assert torch.equal(found[anchored], x[anchored])


def test_consensus_is_an_idempotent_linear_projection(labels):
    x, y = draw(labels, 1), draw(labels, 2)
    agreed = consensus(x, labels)
    torch.testing.assert_close(consensus(agreed, labels), agreed, atol=1e-15, rtol=1e-15)
    combined = consensus(2 * x - 3 * y, labels)
    torch.testing.assert_close(combined, 2 * agreed - 3 * consensus(y, labels), atol=1e-14, rtol=0)
    # orthogonal: what it removes has nothing in common with what agrees
    assert abs(((x - agreed) * consensus(y, labels)).sum()) < 1e-10


def test_consensus_does_not_mind_the_order_of_views(labels):
    x, order = draw(labels), [3, 1, 0, 2]
    expected = consensus(x, labels)[order]
    torch.testing.assert_close(consensus(x[order], labels[order]), expected, atol=1e-15, rtol=1e-15)


def test_consensus_touches_matched_cells_only(labels):
    x = draw(labels)
    alone = (labels < 0)[:, None].expand_as(x)
    changed = consensus(x, labels)
    assert torch.equal(changed[alone], x[alone])
    assert (changed != x)[~alone].all()
    assert torch.equal(consensus(x, torch.full_like(labels, -1)), x)
    assert torch.equal(consensus(x[:1], torch.full_like(labels[:1], -1)), x[:1])


def test_two_views_agree_on_exactly_their_mean():
    labels = torch.full((2, 3, 3), -1)
    labels[0, 0, 1] = labels[1, 2, 2] = 0
    x = draw(labels).float()
    mean = (x[0, :, 0, 1] + x[1, :, 2, 2]) / 2
    found = consensus(x, labels)
    assert torch.equal(found[0, :, 0, 1], mean)
    assert torch.equal(found[1, :, 2, 2], mean)


def test_strength_leads_from_nothing_to_agreement(labels):
    x, agreed = draw(labels), consensus(draw(labels), labels)
    assert torch.equal(consensus(x, labels, strength=0.0), x)
    torch.testing.assert_close(consensus(x, labels, strength=0.25), x + 0.25 * (agreed - x))
    with pytest.raises(UsageError, match=r"outside \[0, 1\]"):
        consensus(x, labels, strength=1.5)


def test_consensus_has_a_gradient(labels):
    small, x = labels[:, 4:8, 4:8], draw(labels[:, 4:8, 4:8], channels=2).requires_grad_()
    anchored = torch.tensor([True, False, False, False])
    assert (small >= 0).any()
    assert torch.autograd.gradcheck(
        lambda t: consensus(t, small, anchored=anchored, strength=0.7), x
    )


def test_a_cluster_holds_one_draw_and_a_view_no_draw_twice(labels):
    noise = draw(labels)
    shared = share_noise(noise, labels)
    given = noise.movedim(1, -1).flatten(0, 2)
    for name in range(int(labels.max()) + 1):
        values = shared.movedim(1, -1)[labels == name]
        assert (values == values[0]).all()
        assert (given == values[0]).all(1).any()
    for view in shared.flatten(2):
        assert len(view.T.unique(dim=0)) == view.shape[1]


def test_views_hold_the_same_draws_where_clusters_are_few(labels):
    few = torch.where(labels < 2, labels, -1)
    shared = share_noise(draw(few), few).flatten(2)
    for view in shared:
        assert torch.equal(view.sort(1).values, shared[0].sort(1).values)
    # what corresponds to nothing and lost no draw starts as every other view does there
    apart = share_noise(draw(few), torch.full_like(few, -1))
    assert (apart == apart[0]).all()


def test_shared_noise_stays_white_and_of_unit_variance_inside_a_view(labels):
    shared = share_noise(draw(labels, channels=2000), labels).flatten(2)  # v c n: 2000 draws
    for view in shared:
        covariance = view.T @ view / len(view)
        # 2000 draws: standard deviation 0.032 on the diagonal, 0.022 off it; six of them
        assert (covariance.diagonal() - 1).abs().max() < 0.2
        assert (covariance - covariance.diagonal().diag()).abs().max() < 0.14


def test_a_mean_of_draws_would_not_keep_the_variance(labels):
    """The trap that share_noise exists to avoid, so that the test above is known to see it."""
    mean = consensus(draw(labels, channels=2000), labels).flatten(2)
    assert (mean.square().mean(1)[labels.flatten(1) >= 0]).max() < 0.7


# ---- warping pictures ----------------------------------------------------------------------------


def paint(view, depth):
    """Colours by world position, smooth over many pixels."""
    points = view.unproject(view.pixel_centres(), depth)
    return 0.5 + 0.4 * torch.sin(3 * points + torch.tensor([0.0, 1.0, 2.0]))


def test_a_painted_scene_looks_the_same_through_another_view():
    a, b = FOUR[1], FOUR[2]
    wall = [plane_depth(c, SLANTED) for c in (a, b)]
    found, valid = warp(paint(b, wall[1]), *seen(a, wall[0]), *seen(b, wall[1]))
    assert valid.double().mean() > 0.8
    # bilinear in 0.4 sin(3 x) between pixels up to 0.05 apart: 9 x 0.4 x 0.05^2 / 8, in x and y
    assert (found - paint(a, wall[0]))[valid].abs().max() < 2.3e-3
    assert (found[~valid] == 0).all()


def test_what_is_hidden_is_not_warped():
    a, b = FOUR[1], FOUR[2]
    xy = a.pixel_centres()
    true, z = b.project(a.unproject(xy, occluded_depth(a)))
    hidden = z > 1.02 * occluded_depth(b, true)
    views = [*seen(a, occluded_depth(a)), *seen(b, occluded_depth(b))]
    _, valid = warp(torch.ones(128, 128, 3), *views)
    assert hidden.sum() > 100
    assert not valid[hidden].any()


def test_a_surface_at_another_depth_is_not_warped():
    view, depth, alpha = seen(FOUR[0])
    image = torch.ones(128, 128, 3)
    _, valid = warp(image, view, depth, alpha, view, 1.02 * depth, alpha)
    assert not valid.any()  # though from the same camera every pixel returns to itself


def test_warping_into_the_same_view_changes_nothing():
    view = seen(FOUR[0], plane_depth(FOUR[0], SLANTED))
    image = torch.rand(128, 128, 3, generator=torch.Generator().manual_seed(0))
    found, valid = warp(image, *view, *view)
    assert valid.all()
    torch.testing.assert_close(found, image, atol=2e-5, rtol=0)  # 128 px x eps32 in the sample grid
