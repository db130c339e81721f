"""Losses of the update on targets that contradict each other: `python -m research.losses`.

Red, green and blue of a synthetic bear change places, which its Gaussians can follow exactly; every
second picture is then moved along a random axis. Prints the gradient of 0.1 Gram over that of the
MSE by features, and the PSNR to the true edit at held-out cameras.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from statistics import fmean

import torch
from jaxtyping import Float
from torch import Tensor

import gsedit
from gsedit.bench.results import markdown_table
from gsedit.bench.synthetic import demo_scene, ring_cameras, surface_gaussians
from gsedit.capture.fitting.settings import UpdateSettings
from gsedit.measures.features import FeatureExtractor, FilterBank
from gsedit.measures.losses import gram_loss, mse
from gsedit.measures.perceptual import VGG, Vgg16, read_weights, vgg_features
from gsedit.paper.editors import Capabilities, EditBatch, EditProgress
from gsedit.paper.editors.looks import parse
from gsedit.paper.strategies.single_pass import SinglePass
from gsedit.views.dataset import capture
from research.command import print_result, run


@dataclass(frozen=True)
class SteppedUpdate(UpdateSettings):
    """Settings of an update in steps of Adam, whatever the loss."""

    @property
    def is_quadratic(self) -> bool:
        """False: a solve is not to be used."""
        return False


ARMS = {
    "MSE, solved": UpdateSettings(patch=48), "MSE, in steps": SteppedUpdate(patch=48),
    "+ 30 Gram": UpdateSettings("mse+30*gram", patch=48),
    "+ 300 Gram": UpdateSettings("mse+300*gram", patch=48),
}  # fmt: skip
MOVED, SEEDS, STEPS = (0, 1, 2, 4), 3, 120


class Misplaced:
    """An editor by which colors change places, and every second picture by some pixels."""

    name, cell = "misplaced", 8
    capabilities = Capabilities(find_ground_truth=lambda *batch: lambda views: views.roll(1, -1))

    def __init__(self, pixels: int, seed: int) -> None:
        self.pixels, self.draws = pixels, torch.Generator().manual_seed(seed)

    def check(self, prompt: str) -> None:
        """Every instruction is as good."""

    def edit(
        self, batch: EditBatch, settings: object, generator: torch.Generator
    ) -> Iterator[EditProgress]:
        """Yield the pictures at once, in one step."""
        images = batch.originals.roll(1, -1)
        for image in images[::2]:
            way, axis = torch.randint(2, (2,), generator=self.draws).tolist()
            image.copy_(image.roll(self.pixels * (2 * way - 1), axis))
        yield EditProgress(1, 1, images)


def gradient_ratio(features: FeatureExtractor, picture: Float[Tensor, "h w 3"]) -> float:
    """Norm of the gradient of 0.1 Gram over that of the MSE, from a picture to its bronze."""
    image = picture.movedim(-1, 0)[None].clone().requires_grad_()
    target = parse("as a bronze statue").variant(picture[None], 0).movedim(-1, 1)
    style = 0.1 * gram_loss(features(image), features(target))
    ours, theirs = (torch.autograd.grad(loss, image)[0] for loss in (style, mse(image, target)))
    return float(ours.norm() / theirs.norm())


def losses() -> None:
    """Print both tables as Markdown."""
    scene = surface_gaussians(demo_scene(), 3000, torch.Generator().manual_seed(0))
    cameras = ring_cameras(demo_scene(), 24, 96)
    data = gsedit.Dataset(capture(scene, cameras, [f"{i:02d}" for i in range(24)]))

    def decibels(arm: str, pixels: int, seed: int) -> float:
        settings = gsedit.EditSettings(
            update=ARMS[arm], views_per_batch=8, batches=1, held_out_edits=0, region="all"
        )
        result = gsedit.edit(
            scene, "swap", editor=Misplaced(pixels, seed), views=data, settings=settings,
            strategy=SinglePass(STEPS), generator=torch.Generator().manual_seed(seed),
        )  # fmt: skip
        return result.metrics.psnr_to_ground_truth or 0.0

    def cell(arm: str, pixels: int) -> str:
        found = [decibels(arm, pixels, seed) for seed in range(SEEDS)]
        return f"{fmean(found):.1f} ({', '.join(f'{each:.2f}' for each in found)})"

    (view,) = capture(scene, ring_cameras(demo_scene(), 1, 64), [""])
    kinds = {"filter bank": FilterBank(), "VGG, layers of equal energy": vgg_features(),
             "VGG in its own units": Vgg16(read_weights(VGG))}  # fmt: skip
    ratios = [(name, f"{gradient_ratio(each, view.image):.2g}") for name, each in kinds.items()]
    print_result(markdown_table(("features", "0.1 Gram over MSE"), ratios))
    rows = [(arm, *(cell(arm, pixels) for pixels in MOVED)) for arm in ARMS]
    print_result(markdown_table(("dB; moved by", *(f"{n} pixels" for n in MOVED)), rows))


if __name__ == "__main__":
    run(losses)
