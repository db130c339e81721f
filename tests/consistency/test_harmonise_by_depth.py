"""Pictures led to agreement at pixel resolution, on a wall and a ball whose depth is a formula."""

from __future__ import annotations

import pytest
import torch
from walls import FOUR, occluded_depth

from gsedit.consistency.harmonise_by_depth import Surface, harmonise_by_depth, low_band
from gsedit.consistency.warp import warp_of

ANCHORED = torch.tensor([True, False, False, False])


@pytest.fixture(scope="module")
def surfaces():
    cameras = [camera.resized(64, 64) for camera in FOUR]
    return [Surface(c, occluded_depth(c).float(), torch.ones(64, 64)) for c in cameras]


@pytest.fixture(scope="module")
def truth(surfaces):
    """Colours painted on the world: coarse ones, and a fine pattern."""
    pictures = []
    for camera, depth, _ in surfaces:
        points = camera.unproject(camera.pixel_centres(), depth.double())
        coarse = 0.5 + 0.2 * torch.sin(2 * points)
        pictures.append(coarse + 0.05 * torch.sin(60 * points[..., :1]))
    return torch.stack(pictures).float()


def tints(views=4):
    """A colour cast of each view's own."""
    generator = torch.Generator().manual_seed(0)
    return 0.06 * torch.randn(views, 1, 1, 3, generator=generator)


def disagreement(images, surfaces):
    """RMS of the pictures' differences where two views show the same."""
    squares = []
    for a, one in enumerate(surfaces):
        for b, other in enumerate(surfaces):
            if a != b:
                warp = warp_of(*one, *other)
                squares.append((warp(images[b]) - images[a])[warp.valid].square().flatten())
    return float(torch.cat(squares).mean().sqrt())


def test_tints_are_brought_together_and_detail_is_kept(surfaces, truth):
    tinted = truth + tints()
    agreed = harmonise_by_depth(tinted, surfaces)
    own = disagreement(truth, surfaces)  # of the fine pattern, between pixels
    before, after = (
        (disagreement(images, surfaces) ** 2 - own**2) ** 0.5 for images in (tinted, agreed)
    )
    assert before > 0.05
    assert after < 0.2 * before
    detail, kept = (images - low_band(images) for images in (tinted, agreed))
    inside = (slice(None), slice(8, -8), slice(8, -8))
    assert kept[inside].square().mean() > 0.97 * detail[inside].square().mean()


def test_pictures_that_agree_are_left_alone(surfaces, truth):
    changed = (harmonise_by_depth(truth, surfaces) - truth).square().mean().sqrt()
    assert changed < 0.005  # what resampling the pattern costs
    flat = torch.full_like(truth, 0.3)
    torch.testing.assert_close(harmonise_by_depth(flat, surfaces), flat)


def test_an_anchor_stays_and_leads(surfaces, truth):
    tinted = truth + tints()
    agreed = harmonise_by_depth(tinted, surfaces, anchored=ANCHORED)
    assert torch.equal(agreed[0], tinted[0])
    cast = (agreed - truth)[1:, 16:-16, 16:-16].mean((1, 2))
    assert (cast - tints()[0, 0]).abs().max() < 0.015


def test_a_view_with_another_edit_is_outvoted(surfaces, truth):
    odd = truth.clone()
    odd[2] = 1 - odd[2]
    agreed = harmonise_by_depth(odd, surfaces)
    others = [0, 1, 3]
    assert (agreed - truth)[others].square().mean().sqrt() < 0.05
    assert (agreed - truth)[2].square().mean() < (odd - truth)[2].square().mean()


def test_strength_leads_from_the_pictures_to_agreement(surfaces, truth):
    tinted = truth + tints()
    assert torch.equal(harmonise_by_depth(tinted, surfaces, strength=0.0), tinted)
    errors = [
        disagreement(harmonise_by_depth(tinted, surfaces, strength=s), surfaces)
        for s in (0.0, 0.5, 1.0)
    ]
    assert errors == sorted(errors, reverse=True)


def test_one_view_and_views_of_nothing_common_stay_as_they_are(surfaces, truth):
    assert torch.equal(harmonise_by_depth(truth[:1], surfaces[:1]), truth[:1])
    empty = [surface._replace(alpha=torch.zeros(64, 64)) for surface in surfaces]
    assert torch.equal(harmonise_by_depth(truth, empty), truth.clamp(0, 1))


def test_the_order_of_views_only_permutes(surfaces, truth):
    tinted, order = truth + tints(), [2, 0, 3, 1]
    straight = harmonise_by_depth(tinted, surfaces)
    permuted = harmonise_by_depth(tinted[order], [surfaces[i] for i in order])
    torch.testing.assert_close(permuted, straight[order])
