"""Finished pictures brought to agreement where cells correspond."""

from __future__ import annotations

import pytest
import torch
from small_scenes import scenes

from gsedit.bench.synthetic import ring_cameras
from gsedit.errors import UsageError
from gsedit.paper.consistency.correspond import Correspondences, correspond
from gsedit.paper.consistency.harmonise import cell_means, harmonise, robust_mean
from gsedit.paper.editors.command.editor import CELL_PIXELS


def test_few_values_have_their_mean_and_many_outvote_one():
    groups = torch.tensor([0, 1, 1, 2, 2, 2, 2, 2])
    values = torch.tensor([0.3, 0.2, 0.8, 0.5, 0.51, 0.49, 0.5, 1.0])[:, None].expand(-1, 3)
    found = robust_mean(values, groups, 3, torch.ones(8))
    torch.testing.assert_close(found[:2, 0], torch.tensor([0.3, 0.5]))
    assert abs(float(found[2, 0]) - 0.5) < 0.03  # the mean is 0.6
    wide = robust_mean(values, groups, 3, torch.ones(8), tolerance=1e3)
    torch.testing.assert_close(wide[2, 0], torch.tensor(0.6))
    outvoted = torch.tensor([1.0, 1, 0, 1, 1, 1, 1, 0])
    without = robust_mean(values, groups, 3, outvoted)
    torch.testing.assert_close(without[:, 0], torch.tensor([0.3, 0.2, 0.5]), atol=1e-6, rtol=0)


def flat_views(*colors: float, side: int = 8) -> torch.Tensor:
    return torch.tensor(colors)[:, None, None, None].expand(-1, side, side, 3).contiguous()


def everywhere(views: int, side: int = 8, cell: int = 2) -> Correspondences:
    """Cell i of every view shows the same."""
    count = side // cell
    labels = torch.arange(count**2).reshape(1, count, count).expand(views, -1, -1).contiguous()
    return Correspondences(labels, torch.ones(views, views), cell)


def test_agreement_laws():
    found = everywhere(3)
    images = flat_views(0.2, 0.3, 0.4)
    torch.testing.assert_close(harmonise(images, found), flat_views(0.3, 0.3, 0.3))
    torch.testing.assert_close(harmonise(images, found, strength=0.5), flat_views(0.25, 0.3, 0.35))
    assert torch.equal(harmonise(images, found, strength=0.0), images)
    led = harmonise(images, found, anchored=torch.tensor([True, False, False]))
    torch.testing.assert_close(led, flat_views(0.2, 0.2, 0.2))
    assert torch.equal(led[0], images[0])
    alone = Correspondences(torch.full((3, 4, 4), -1), torch.eye(3), 2)
    assert torch.equal(harmonise(images, alone), images)
    noise = torch.rand(3, 8, 8, 3, generator=torch.Generator().manual_seed(0))
    order = torch.tensor([2, 0, 1])
    # 1e-6: sums over views in another order
    torch.testing.assert_close(
        harmonise(noise[order], found), harmonise(noise, found)[order], rtol=0, atol=1e-6
    )
    with pytest.raises(UsageError, match="match the cells"):
        harmonise(noise[:2], found)
    with pytest.raises(UsageError, match="strength"):
        harmonise(noise, found, strength=2.0)


def test_detail_that_agrees_on_average_is_left_alone():
    """A pattern finer than a cell, shifted in one view: the means agree, and nothing is blurred."""
    stripes = torch.arange(8).remainder(2).float()[None, :, None].expand(8, -1, 3)
    images = torch.stack((stripes, 1 - stripes))
    torch.testing.assert_close(harmonise(images, everywhere(2)), images)


def test_sides_that_are_no_whole_cells():
    labels = torch.arange(12).reshape(1, 4, 3).expand(2, -1, -1).contiguous()
    found = Correspondences(labels, torch.ones(2, 2), 2)
    images = torch.stack((torch.full((7, 5, 3), 0.2), torch.full((7, 5, 3), 0.6)))
    torch.testing.assert_close(harmonise(images, found), torch.full((2, 7, 5, 3), 0.4))
    assert cell_means(images, 2).shape == (2, 4, 3, 3)


@pytest.fixture(scope="module")
def painted():
    """(originals, their true edit, correspondences, where views correspond): depth is exact."""
    (scene,) = (each for each in scenes() if each.name == "globe")  # the quickest to trace
    cameras = ring_cameras(scene, 20, 128)[:5]
    traced = [scene.trace(camera, 2) for camera in cameras]
    originals = torch.stack([t.image for t in traced]).float()
    found = correspond(
        cameras,
        torch.stack([t.depth for t in traced]),
        torch.stack([t.hit.double() for t in traced]),
        cell=CELL_PIXELS,
    )
    where = (found.labels >= 0).repeat_interleave(CELL_PIXELS, 1).repeat_interleave(CELL_PIXELS, 2)
    return originals, 1 - originals.flip(-1), found, where


def disagreement(images: torch.Tensor, found: Correspondences) -> float:
    """RMSE of cells about the plain mean of their cluster."""
    rows = found.labels.reshape(-1) >= 0
    values = cell_means(images, found.cell).reshape(-1, 3)[rows]
    groups = found.labels.reshape(-1)[rows].long()
    center = robust_mean(values, groups, found.count, torch.ones(len(values)), 1e3)
    return float((values - center[groups]).square().mean().sqrt())


def test_tints_of_views_are_evened_out_and_the_edit_is_kept(painted):
    originals, truth, found, where = painted
    g = torch.Generator().manual_seed(0)
    gains = 1 + 0.1 * torch.randn(5, 1, 1, 3, generator=g)
    edited = (truth * gains).clamp(0, 1)
    harmonised = harmonise(edited, found)
    # what stays is detail in which the nearest cells of true edits differ too
    assert disagreement(harmonised, found) < 0.3 * disagreement(edited, found)
    assert disagreement(harmonised, found) < 1.5 * disagreement(truth, found)
    error, before = (float((x - truth)[where].square().mean().sqrt()) for x in (harmonised, edited))
    assert error < 0.71 * before  # a cluster of two keeps 1 / sqrt(2) of their tints, larger less
    kept = (harmonised - originals)[where].mean() / (edited - originals)[where].mean()
    assert 0.97 < float(kept) < 1.03
    outside = torch.nn.functional.max_pool2d(where[:, None].double(), 21, 1, 10)[:, 0] == 0
    assert torch.equal(harmonised[outside], edited[outside])


def test_a_view_with_another_edit_is_outvoted(painted):
    originals, truth, found, where = painted
    edited = truth.clone()
    edited[2] = originals[2]  # this view was not edited at all
    harmonised, plain = harmonise(edited, found), harmonise(edited, found, tolerance=1e3)

    def error(images: torch.Tensor, view: slice | int) -> float:
        return float((images - truth)[view][where[view]].square().mean().sqrt())

    assert error(harmonised, 2) < 0.5 * error(edited, 2)
    others = [view for view in range(5) if view != 2]
    for view in others:  # the mean drags them; a vote of two against one cannot be won
        assert error(harmonised, view) < error(plain, view)
    assert error(harmonised, slice(None)) < 0.7 * error(plain, slice(None))


def test_the_true_edit_is_hardly_damaged(painted):
    _, truth, found, where = painted
    damage = float((harmonise(truth, found) - truth)[where].square().mean().sqrt())
    assert damage < 0.5 * disagreement(truth, found)  # averaging the cells would cost all of it
