"""Pictures led to agreement at pixel resolution, on a wall and a ball whose depth is a formula."""

import pytest
import torch
from walls import FOUR, SLANTED, occluded_depth, plane_depth, seen

from gsedit.paper.consistency.harmonise import Surface, harmonise_by_depth
from gsedit.views.depth_maps import warp_of

ANCHORED = torch.tensor([True, False, False, False])


def painted(camera, depth, fine=0.05):
    """Colors painted on the world: coarse ones, and a fine pattern."""
    points = camera.unproject(camera.pixel_centers(), depth.double())
    coarse = 0.5 + 0.2 * torch.sin(2 * points)
    return (coarse + fine * torch.sin(30 * points[..., :1])).float()


@pytest.fixture(scope="module")
def surfaces():
    """Surfaces of a grey scene, seen from four cameras."""
    cameras = [camera.resized(64, 64) for camera in FOUR]
    return [
        Surface(c, occluded_depth(c).float(), torch.ones(64, 64), torch.full((64, 64, 3), 0.5))
        for c in cameras
    ]


@pytest.fixture(scope="module")
def truth(surfaces):
    """Its edit, as every view should show it."""
    return torch.stack([painted(surface.camera, surface.depth) for surface in surfaces])


def tints(views=4):
    """A color cast of each view's own."""
    generator = torch.Generator().manual_seed(0)
    return 0.06 * torch.randn(views, 1, 1, 3, generator=generator)


def disagreement(images, surfaces):
    """RMS of the pictures' differences where two views show the same."""
    squares = []
    for a, one in enumerate(surfaces):
        for b, other in enumerate(surfaces):
            if a != b:
                warp = warp_of(*one[:3], *other[:3])
                squares.append((warp(images[b]) - images[a])[warp.valid].square().flatten())
    return float(torch.cat(squares).mean().sqrt())


def test_tints_are_brought_together_and_detail_is_kept(surfaces, truth):
    tinted = truth + tints()
    agreed = harmonise_by_depth(tinted, surfaces)
    before, after = (disagreement(images, surfaces) for images in (tinted, agreed))
    assert before > 0.07
    assert after < disagreement(truth, surfaces) + 0.01  # of the fine pattern, between pixels
    detail, kept = (images.diff(dim=2).square().mean() for images in (tinted, agreed))
    assert kept > 0.8 * detail  # at 64 pixels the band reaches to half a pixel


def test_what_the_unedited_scene_differs_in_is_left(surfaces, truth):
    """Surfaces that look different from view to view, and an edit that keeps this."""
    shiny = [s._replace(color=(s.color + t[0]).clamp(0, 1)) for s, t in zip(surfaces, tints())]
    unedited = torch.stack([surface.color for surface in shiny])
    assert torch.equal(harmonise_by_depth(unedited, shiny), unedited)
    halved = 0.5 + 0.5 * (unedited - 0.5)
    assert torch.equal(harmonise_by_depth(halved, shiny), halved)
    doubled = 0.5 + 2 * (unedited - 0.5)
    left = disagreement(harmonise_by_depth(doubled, shiny), shiny)
    assert left < 1.15 * disagreement(unedited, shiny) < 0.6 * disagreement(doubled, shiny)


def test_pictures_that_agree_are_left_alone(surfaces, truth):
    changed = (harmonise_by_depth(truth, surfaces) - truth).square().mean().sqrt()
    assert changed < 0.005  # what resampling the pattern costs
    flat = torch.full_like(truth, 0.3)
    torch.testing.assert_close(harmonise_by_depth(flat, surfaces), flat)


def test_an_anchor_stays_and_leads(surfaces, truth):
    tinted = truth + tints()
    agreed = harmonise_by_depth(tinted, surfaces, anchored=ANCHORED)
    assert torch.equal(agreed[0], tinted[0])
    wrong = agreed - truth - tints()[0]
    for a in (1, 2, 3):
        seen = warp_of(*surfaces[a][:3], *surfaces[0][:3]).valid
        assert wrong[a][seen].square().mean().sqrt() < 0.006


def test_a_view_with_another_edit_is_outvoted(surfaces, truth):
    odd = truth.clone()
    odd[2] = 1 - odd[2]
    agreed = harmonise_by_depth(odd, surfaces)
    others = [0, 1, 3]
    assert (agreed - truth)[others].square().mean().sqrt() < 0.05
    assert (agreed - truth)[2].square().mean() < (odd - truth)[2].square().mean()


def test_one_view_and_views_of_nothing_common_stay_as_they_are(surfaces, truth):
    assert torch.equal(harmonise_by_depth(truth[:1], surfaces[:1]), truth[:1])
    empty = [surface._replace(alpha=torch.zeros(64, 64)) for surface in surfaces]
    assert torch.equal(harmonise_by_depth(truth, empty), truth.clamp(0, 1))


def test_the_order_of_views_only_permutes(surfaces, truth):
    tinted, order = truth + tints(), [2, 0, 3, 1]
    straight = harmonise_by_depth(tinted, surfaces)
    permuted = harmonise_by_depth(tinted[order], [surfaces[i] for i in order])
    torch.testing.assert_close(permuted, straight[order])


# ---- a picture seen through another view ---------------------------------------------------------


def paint(view, depth):
    """Colors by world position, smooth over many pixels."""
    points = view.unproject(view.pixel_centers(), depth)
    return 0.5 + 0.4 * torch.sin(3 * points + torch.tensor([0.0, 1.0, 2.0]))


def test_a_painted_scene_looks_the_same_through_another_view():
    a, b = FOUR[1], FOUR[2]
    wall = [plane_depth(c, SLANTED) for c in (a, b)]
    warp = warp_of(*seen(a, wall[0]), *seen(b, wall[1]))
    found, valid = warp(paint(b, wall[1])), warp.valid
    assert valid.double().mean() > 0.8
    # bilinear in 0.4 sin(3 x) between pixels up to 0.05 apart: 9 x 0.4 x 0.05^2 / 8, in x and y
    assert (found - paint(a, wall[0]))[valid].abs().max() < 2.3e-3
    assert (found[~valid] == 0).all()


def test_what_is_hidden_is_not_warped():
    a, b = FOUR[1], FOUR[2]
    xy = a.pixel_centers()
    true, z = b.project(a.unproject(xy, occluded_depth(a)))
    hidden = z > 1.02 * occluded_depth(b, true)
    views = [*seen(a, occluded_depth(a)), *seen(b, occluded_depth(b))]
    valid = warp_of(*views).valid
    assert hidden.sum() > 100
    assert not valid[hidden].any()


def test_a_surface_at_another_depth_is_not_warped():
    view, depth, alpha = seen(FOUR[0])
    valid = warp_of(view, depth, alpha, view, 1.02 * depth, alpha).valid
    assert not valid.any()  # though from the same camera every pixel returns to itself


def test_warping_into_the_same_view_changes_nothing():
    view = seen(FOUR[0], plane_depth(FOUR[0], SLANTED))
    image = torch.rand(128, 128, 3, generator=torch.Generator().manual_seed(0))
    warp = warp_of(*view, *view)
    assert warp.valid.all()
    torch.testing.assert_close(
        warp(image), image, atol=2e-5, rtol=0
    )  # 128 px x eps32 in the sample grid
