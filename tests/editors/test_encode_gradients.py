"""Every autoencoder is differentiable in the pictures: score distillation descends through it."""

from __future__ import annotations

import pytest
import torch
from small_networks import random_network

from gsedit.editors.closed_form import ClosedForm
from gsedit.editors.pix2pix.load import load_pix2pix
from gsedit.editors.small.denoiser import Small


def slope_error(denoiser, step: float) -> float:
    """How far the gradient of a random combination of latents is from differences, relatively."""
    generator = torch.Generator().manual_seed(0)
    images = torch.rand(1, 32, 32, 3, generator=generator).requires_grad_()
    direction = torch.randn(images.shape, generator=generator)
    latents = denoiser.encode(images)
    weights = torch.randn(latents.shape, generator=generator)
    (gradient,) = torch.autograd.grad((weights * latents).sum(), images)
    slope = (gradient * direction).sum()
    with torch.no_grad():
        ahead, behind = (
            (weights * denoiser.encode(images + sign * step * direction)).sum() for sign in (1, -1)
        )
    return float(((ahead - behind) / (2 * step) - slope).abs() / slope.abs())


def test_closed_form():
    assert slope_error(ClosedForm(), 1e-2) < 1e-3


def test_small():
    assert slope_error(Small(random_network()), 1e-2) < 1e-3


@pytest.mark.usefixtures("offline")
def test_pix2pix(folder):
    model = load_pix2pix(folder)
    assert slope_error(model, 1e-3) < 2e-2
    assert not any(p.requires_grad for p in model.vae.parameters())
