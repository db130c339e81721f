"""Small Gaussian scenes for the laws of the renderer, each with the reason why it is here.

All float64, and none by a global draw. A camera looks along +z from the origin unless it says so.
The stiff and extreme ones are in gsedit/bench/renderer/stability.py.
"""

from __future__ import annotations

from collections.abc import Callable
from math import sqrt

import torch

from gsedit.bench.renderer.stability import camera, gaussian, random_cloud
from rasterizer import Camera, Gaussians, concatenate
from rasterizer.numerics import DEFAULT, SH_DC

EdgeCase = tuple[Gaussians, Camera]


def one() -> EdgeCase:
    """One Gaussian off the center of pixels and picture: every formula, alone."""
    return gaussian((0.13, -0.07, 2.0), (0.3, 0.1, 0.2), (0.9, 0.2, -0.3, 0.1)), camera()


def intersecting() -> EdgeCase:
    """Two long Gaussians through each other: order is by center, for every pixel alike."""
    first = gaussian((0.0, 0.0, 2.0), (0.8, 0.05, 0.05), (0.9, 0.0, 0.4, 0.0))
    second = gaussian(
        (0.1, 0.05, 2.1), (0.8, 0.05, 0.05), (0.9, 0.0, -0.4, 0.1), color=(0.1, 0.6, 0.9)
    )
    return concatenate(first, second), camera()


def wall() -> EdgeCase:
    """A flat grid of opaque discs, tilted: a surface, with depth that is known everywhere."""
    y, x = torch.meshgrid(
        torch.linspace(-1.2, 1.2, 17, dtype=torch.float64),
        torch.linspace(-1.5, 1.5, 21, dtype=torch.float64),
        indexing="ij",
    )
    rows = [
        gaussian(
            (u, v, 2.5 + 0.2 * u), (0.12, 0.12, 0.005), opacity=0.98, color=(0.5 + u / 4, 0.5, 0.3)
        )
        for u, v in zip(x.flatten().tolist(), y.flatten().tolist())
    ]
    return concatenate(*rows), camera()


def shell(n: int = 400) -> EdgeCase:
    """Discs on a sphere (a Fibonacci lattice): front hides back, the rim is seen edge-on."""
    size = 0.07 * (400 / n) ** 0.5  # the same overlap
    i = torch.arange(n, dtype=torch.float64) + 0.5
    z = 1 - 2 * i / n
    angle = i * torch.pi * (3 - sqrt(5))
    ring = (1 - z * z).sqrt()
    normal = torch.stack((ring * angle.cos(), ring * angle.sin(), z), -1)
    upper = torch.where(z[:, None] < 0, -normal, normal)
    quats = torch.stack((1 + upper[:, 2], -upper[:, 1], upper[:, 0], torch.zeros(n)), -1)
    return Gaussians(
        means=0.8 * normal + torch.tensor((0.0, 0.0, 3.0), dtype=torch.float64),
        quats=quats,
        log_scales=torch.tensor((size, size, size / 10), dtype=torch.float64).log().repeat(n, 1),
        logit_opacities=torch.full((n,), 4.0, dtype=torch.float64),
        sh=(0.45 * normal / SH_DC)[:, None, :],
    ), camera()


def off_screen() -> EdgeCase:
    """Centers outside the picture, footprints inside: culling is by footprint, not by center."""
    left = gaussian((-1.3, 0.0, 2.0), (0.3, 0.2, 0.1))
    far_aside = gaussian((3.0, 2.0, 1.0), (1.5, 1.5, 0.5), color=(0.2, 0.3, 0.9))
    return concatenate(left, far_aside), camera()


def opaque_stack() -> EdgeCase:
    """Forty opaque layers in a row: the stop, and the cap of alpha at 0.99."""
    layers = [
        gaussian(
            (0.0, 0.0, 2 + 0.05 * i), (0.5, 0.5, 0.01), opacity=0.9999, color=(i / 40, 0.5, 0.3)
        )
        for i in range(40)
    ]
    return concatenate(*layers), camera()


def faint() -> EdgeCase:
    """Opacities around 1/255: on either side of the floor, and far below it."""
    floor = DEFAULT.alpha_min
    rows = [
        gaussian((0.2 * i - 0.5, 0.1, 2.0), (0.2, 0.2, 0.2), opacity=floor * factor)
        for i, factor in enumerate((1e-6, 0.99, 1.01, 1.5, 3.0))
    ]
    return concatenate(*rows), camera()


def sub_pixel() -> EdgeCase:
    """Far smaller than a pixel, at pixel corners and centers: only the blur keeps them in sight."""
    rows = [
        gaussian((x / 20, y / 20, 2.0), (1e-4, 1e-4, 1e-4), opacity=0.9)
        for x in (-4.8, 0.2, 3.0)
        for y in (-2.0, 0.5, 4.1)
    ]
    return concatenate(*rows), camera()


def cloud() -> EdgeCase:
    """300 random ones with view-dependent color: everything at once."""
    return random_cloud(300, seed=1, degree=3), camera()


EDGE_CASES: dict[str, Callable[[], EdgeCase]] = {
    scene.__name__: scene
    for scene in (one, intersecting, wall, shell, off_screen, opaque_stack, faint, sub_pixel, cloud)
}
