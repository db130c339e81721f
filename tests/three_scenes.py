"""Three small scenes of which an edit can leave out different work."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from gsedit import Dataset
from gsedit.paper.editors import Capabilities, EditProgress
from gsedit.views.dataset import capture
from gsedit.views.orbit import circle
from rasterizer import Gaussians, concatenate, look_at
from rasterizer.numerics import SH_DC

SIZE = 48
UP = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)


class Swapped:
    """A 2D editor that needs no diffusion: red and blue change places."""

    name, cell = "swapped", 8
    capabilities = Capabilities()

    def find_ground_truth(self, prompt, edited, originals):
        return lambda pictures: pictures.flip(-1)

    def check(self, prompt):
        return None

    def edit(self, batch, settings, generator):
        self.batch = batch
        yield EditProgress(1, 1, batch.originals.flip(-1))


@dataclass(frozen=True, eq=False)
class Exhibit:
    scene: Gaussians
    data: Dataset
    region: str
    """As --region has it."""


def blobs(seed, count, size, spread=0.6, middle=(0.0, 0.0, 0.0), degree=0, opacity=2.0):
    """Round Gaussians of random colors about a point."""
    random = torch.Generator().manual_seed(seed)
    direction = torch.nn.functional.normalize(torch.randn(count, 3, generator=random), dim=-1)
    sh = torch.zeros(count, (degree + 1) ** 2, 3)
    sh[:, 0] = (torch.rand(count, 3, generator=random) - 0.5) / SH_DC
    return Gaussians(
        means=torch.tensor(middle) + spread * direction,
        quats=torch.tensor([1.0, 0, 0, 0]).repeat(count, 1),
        log_scales=torch.full((count, 3), size).log(),
        logit_opacities=torch.full((count,), opacity),
        sh=sh,
    )


def rendered(scene, cameras):
    return Dataset(capture(scene, cameras, [f"{i:02d}" for i in range(len(cameras))]))


def ring(count, radius=0.8, size=SIZE):
    middle = torch.zeros(3, dtype=torch.float64)
    return circle(middle, radius, UP, count, size, elevation=15.0, fov=45.0)


def ball() -> Exhibit:
    """A closed ball with harmonics of degree 3 that are all zero; 60 Gaussians inside it and 40 far
    away that no camera sees."""
    shell = blobs(0, 700, 0.08, degree=3, opacity=4.0)
    inside = blobs(1, 60, 0.01, spread=0.05, degree=3)
    far = blobs(2, 40, 0.05, middle=(0.0, 0.0, 300.0), degree=3)
    scene = concatenate(shell, inside, far)
    return Exhibit(scene, rendered(scene, ring(9)), "all")


def rows_of_two() -> Exhibit:
    """Two clusters far apart, each seen by its own cameras, and colors that depend on the view;
    only a part of one cluster is edited."""
    left, right = (
        blobs(seed, 250, 0.06, 0.4, (x, 0.0, 0.0), degree=1) for seed, x in ((3, -6.0), (4, 6.0))
    )
    scene = concatenate(left, right)
    random = torch.Generator().manual_seed(5)
    scene.sh[:, 1:] = 0.1 * torch.randn(500, 3, 3, generator=random)
    cameras = [
        look_at(torch.tensor([x + dx, -1.8, dz]), torch.tensor([x, 0.0, 0.0]), UP, 45.0, SIZE, SIZE)
        for x in (-6.0, 6.0)
        for dx, dz in ((-0.5, 0.1), (0.0, 0.2), (0.5, 0.1), (0.2, 0.5))
    ]
    return Exhibit(scene, rendered(scene, cameras), "sphere:-6,0,0.4,0.25")


def soft() -> Exhibit:
    """Few wide Gaussians in pictures of many pixels."""
    scene = blobs(6, 40, 0.25)
    return Exhibit(scene, rendered(scene, ring(8, 1.2, 96)), "all")


EXHIBITS = {"ball": ball, "two": rows_of_two, "soft": soft}
