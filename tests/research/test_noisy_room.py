"""The room full of floaters: what no camera of its capture saw goes, and other views gain by it."""

from __future__ import annotations

import torch
from research.noisy_room import cameras, room

from gsedit.synthetic import surface_gaussians
from gsedit.toolkit import clean
from rasterizer import Camera, Gaussians, concatenate, render


@torch.no_grad()
def pictures(scene: Gaussians, views: list[Camera]) -> torch.Tensor:
    return torch.stack([render(scene, camera).color for camera in views])


def test_clean_gains_a_decibel_where_the_capture_did_not_look():
    draw = torch.Generator().manual_seed(5)
    scene = room(draw)
    exact = surface_gaussians(scene, 1500, draw)
    inside = torch.randint(len(exact), (300,), generator=draw)
    anywhere = (torch.rand(300, 3, generator=draw) - 0.5) * torch.tensor((2.4, 2.4, 1.5))
    wrong = exact[inside].map(torch.clone)
    wrong.means.copy_(anywhere)
    wrong.log_scales.fill_(-3.0)
    # what a capture sees is mended by its fit: only the floaters that it does not see stay
    used = [c.resized(32, 32) for c in cameras(scene, 8, -0.5, 70.0, draw)]
    shown = torch.stack([(c.project(wrong.means.double())[1] > 0) for c in used]).any(0)
    full = concatenate(exact, wrong[~shown])
    held_out = [c.resized(32, 32) for c in cameras(scene, 6, -1.0, 50.0, draw)]
    truth = pictures(exact, held_out)
    errors = [
        (pictures(each, held_out) - truth).square().mean()
        for each in (full, clean(full, cameras=used))
    ]
    assert 10 * float((errors[0] / errors[1]).log10()) > 1.0
