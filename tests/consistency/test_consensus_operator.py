"""Laws of the consensus operator and of shared noise, on clusters of real views."""

import pytest
import torch
from walls import CELL, FOUR, stacked

from gsedit.paper.consistency.consensus import consensus, share_noise
from gsedit.paper.consistency.correspond import correspond


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


def test_consensus_has_a_gradient(labels):
    small, x = labels[:, 4:8, 4:8], draw(labels[:, 4:8, 4:8], channels=2).requires_grad_()
    anchored = torch.tensor([True, False, False, False])
    assert (small >= 0).any()
    assert torch.autograd.gradcheck(lambda t: consensus(t, small, anchored=anchored), x)


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
