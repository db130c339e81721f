"""Error against run time of the renderer, on scenes made here and on the garden: `make bench`."""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Callable, Iterator

import torch
from garden import POINTS, garden

from gsedit.synthetic import ring_cameras, scenes, surface_gaussians
from rasterizer import Camera, Gaussians, render
from rasterizer.reference import render_reference

FIELDS = ("means", "quats", "log_scales", "logit_opacities", "sh")


def exhibits() -> Iterator[tuple[str, Gaussians, Camera]]:
    """Name, scene and camera of every row."""
    for scene in scenes():
        splats = surface_gaussians(scene, 10_000, torch.Generator().manual_seed(0))
        yield scene.name, splats, ring_cameras(scene, 1, 128)[0]
    if POINTS.exists():
        for scale in (0.25, 1.0):
            yield f"garden x {scale}", *garden(scale)


def gradients(function: Callable, scene: Gaussians, camera: Camera) -> tuple[torch.Tensor, list]:
    """A picture, and the gradients of its product with fixed random weights."""
    leaves = scene.map(lambda t: t.clone().requires_grad_())
    picture = function(leaves, camera).color
    weights = torch.randn(picture.shape, generator=torch.Generator().manual_seed(0))
    loss = (picture * weights.to(picture)).sum()
    return picture.detach(), torch.autograd.grad(loss, [getattr(leaves, f) for f in FIELDS])


def seconds(work: Callable[[], object], runs: int = 5) -> float:
    """Median wall clock of some runs after one that is not counted."""
    work()
    times = []
    for _ in range(runs):
        began = time.perf_counter()
        work()
        times.append(time.perf_counter() - began)
    return statistics.median(times)


def row(name: str, scene: Gaussians, camera: Camera) -> str:
    """One line: size, times, and what they cost in error against the float64 reference."""
    with torch.no_grad():
        forward = seconds(lambda: render(scene, camera))
    both = seconds(lambda: gradients(render, scene, camera))
    found, found_gradients = gradients(render, scene, camera)
    wanted, wanted_gradients = gradients(render_reference, scene, camera)
    error = (found.double() - wanted).abs().flatten()
    worst = max(float((a - b).norm() / b.norm()) for a, b in zip(found_gradients, wanted_gradients))
    tail = float(error.kthvalue(int(0.999 * len(error))).values)
    return (
        f"| {name} | {len(scene):,} | {camera.width}x{camera.height} | {1e3 * forward:.0f} | "
        f"{1e3 * both:.0f} | {error.mean():.1e} | {tail:.1e} | {worst:.1e} |"
    )


if __name__ == "__main__":
    head = (
        "scene | Gaussians | pixels | forward ms | + backward ms | mean error | 99.9 % | gradients"
    )
    sys.stdout.write(f"float32, {torch.get_num_threads()} threads, medians of 5\n\n| {head} |\n")
    sys.stdout.write("|" + "---|" * 8 + "\n")
    for exhibit in exhibits():
        sys.stdout.write(row(*exhibit) + "\n")
        sys.stdout.flush()
