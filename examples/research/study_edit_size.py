"""At which size `small` edits best, and how a change of small pictures is carried to full size.

python -m research.study_edit_size bear.ply photos/

The subject, for the true edits, is an upright cylinder that holds the bear of Instruct-NeRF2NeRF.
Prints two tables: the true edit made smaller and carried up, and the editor's edit at each size,
carried up; both against the true edit of the 512-pixel photos.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import torch
import torch.nn.functional as F
from torch import Tensor

import gsedit
from gsedit.datasets.dataset import evenly_spaced
from gsedit.datasets.image_ops import downscale
from gsedit.diffusion.settings import SamplerSettings
from gsedit.editing.guided import carry_change
from gsedit.editors import EditBatch, make_editor
from gsedit.measures.metrics import psnr, ssim
from research.train_small.captured import UprightCylinder, captured, focus_point, mean_up
from research.train_small.prompts import held_out_prompts
from research.train_small.sources import Sources
from research.train_small.target_edits import target_images

FULL, PHOTOS = 512, 3
LOOKS = [
    "bronze",
    "gold",
    "jade",
    "ice",
    "red",
    "wood",
    "snow",
    "night",
    "autumn",
    "sketch",
    "sepia",
]
Carry = Callable[[Tensor, Tensor, Tensor], Tensor]


def interpolated(edited: Tensor, original: Tensor, full: Tensor) -> Tensor:
    """The change, interpolated: what a guide must beat."""
    change = (edited - original).movedim(-1, 1)
    change = F.interpolate(change, full.shape[1:3], mode="bilinear").movedim(1, -1)
    return (full + change).clamp(0, 1)


METHODS: dict[str, Carry] = {"interpolated": interpolated, "guided": carry_change}


def photos(scene: Path, data: Path, size: int = FULL, count: int = PHOTOS) -> Sources:
    """Evenly spaced photos, with the scene's geometry and the subject's mask."""
    dataset = gsedit.load_dataset(data, size=size)
    cameras = [view.camera for view in dataset.views]
    subject = UprightCylinder(focus_point(cameras), mean_up(cameras), 1.6, -0.57)
    views = [dataset.views[i] for i in evenly_spaced(len(dataset), count)]
    return captured(gsedit.load(scene).detach(), views, subject)


def shrink(images: Tensor, size: int) -> Tensor:
    """Square pictures of that side."""
    return torch.stack([downscale(image, size, size).clamp(0, 1) for image in images])


def edited(images: Tensor, look: str) -> Tensor:
    """By `small`, every picture on its own, in a wording that its training did not use."""
    batch = EditBatch(images, images, held_out_prompts((look,))[0])
    generator = torch.Generator().manual_seed(0)
    *_, last = make_editor("small").edit(batch, SamplerSettings(), generator)
    assert last.images is not None
    return last.images


def compare(sources: Sources, looks: list[str], sizes: list[int], true: bool) -> None:
    """Print a table of means over looks and photos."""
    full = sources.image
    for size in sizes:
        small, scores = shrink(full, size), {name: [] for name in METHODS}
        for look in looks:
            truth = target_images(sources, (look,))
            change = shrink(truth, size) if true else edited(small, look)
            for name, carry in METHODS.items():
                carried = carry(change, small, full)
                scores[name].append((psnr(carried, truth), ssim(carried, truth)))
        for name, rows in scores.items():
            decibels, similarity = (sum(column) / len(rows) for column in zip(*rows))
            what = "true edit" if true else "small"
            sys.stdout.write(f"{what} {size} {name}: {decibels:.2f} dB, SSIM {similarity:.4f}\n")


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    pictures = photos(Path(sys.argv[1]), Path(sys.argv[2]))
    compare(pictures, LOOKS, [96, 192], true=True)
    compare(pictures, LOOKS, [128, 192, 256, 384, 512], true=False)
