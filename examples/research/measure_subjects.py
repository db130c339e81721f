"""Measure what is found as the subject of a capture, by masks that were drawn by hand.

    python -m research.measure_subjects ../shared/data subjects.csv bear.ply garden-draft.ply ...

For each scene, writes the mean and least IoU of the region's render with the masks, at the photos
that they were drawn on; the shares of the rim, RIM pixels on either side of the outline, that are
bare inside and spilt on outside; what red paint changes outside (PSNR), and seconds: for `auto`,
for one click in the middle of the first mask, and for a phrase.
Masks are drawn on photos as the camera took them, and are undistorted as photos are.
"""

from __future__ import annotations

import csv
import json
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from shutil import copyfile

import torch
from jaxtyping import Bool
from torch import Tensor
from torch.nn.functional import max_pool2d

from gsedit import load
from gsedit.select.click import Click, Selector
from gsedit.select.finder import Finder
from gsedit.select.region import Region, coverage
from gsedit.select.subject import find_subject
from gsedit.views.load import load_dataset
from gsedit.views.viewpoints import viewpoints_of
from rasterizer.camera import Camera
from rasterizer.numerics import color_to_sh
from rasterizer.render import render
from rasterizer.scene import Gaussians

WANTED = {"bear": ["bear"], "garden": ["table", "vase"], "dinosaur": ["dino"]}
"""Mask sets of the subject of each capture; the subject is their union."""
PHRASES = {"bear": "the bear", "garden": "the table", "dinosaur": "the dinosaur"}
"""Phrases of a sentence for it."""
RIM = 2
"""Pixels off the outline from which a pixel is outside: masks are off by about as much."""


@dataclass(frozen=True, eq=False)
class Truth:
    """Hand-drawn masks at the cameras of their photos."""

    cameras: tuple[Camera, ...]
    masks: tuple[Bool[Tensor, "h w"], ...]

    def iou(self, region: Region, scene: Gaussians) -> list[float]:
        """IoU of the region's render with each mask."""
        shown = [coverage(region, scene, camera) > 0.5 for camera in self.cameras]
        pairs = zip(shown, self.masks, strict=True)
        return [float((a & b).sum() / (a | b).sum().clamp_min(1)) for a, b in pairs]

    def rim(self, region: Region, scene: Gaussians) -> tuple[float, float]:
        """(bare, spilt): shares of the pixels up to RIM inside and outside of the outlines that the
        region does not show, and shows."""
        bare, spilt = [], []
        for camera, mask in zip(self.cameras, self.masks, strict=True):
            shown = coverage(region, scene, camera) > 0.5
            inner, outer = mask & grown(~mask), ~mask & grown(mask)
            bare.append(float((inner & ~shown).sum() / inner.sum().clamp_min(1)))
            spilt.append(float((outer & shown).sum() / outer.sum().clamp_min(1)))
        return sum(bare) / len(bare), sum(spilt) / len(spilt)

    def leak(self, region: Region, scene: Gaussians) -> float:
        """PSNR outside the masks, RIM pixels off them, of the scene with the region in red."""
        red = scene.sh.clone()
        red[region.inside] = 0
        red[region.inside, 0] = color_to_sh(torch.tensor((1.0, 0.0, 0.0)))
        painted, errors = replace(scene, sh=red), []
        for camera, mask in zip(self.cameras, self.masks, strict=True):
            pair = [render(each, camera).color.clamp(0, 1) for each in (scene, painted)]
            errors.append((pair[0] - pair[1]).square()[~grown(mask)].mean())
        return float(-10 * torch.stack(errors).mean().log10())


def grown(mask: Bool[Tensor, "h w"]) -> Bool[Tensor, "h w"]:
    """The mask and all within RIM pixels of it."""
    return max_pool2d(mask[None].float(), 2 * RIM + 1, 1, RIM)[0] > 0


def read_truth(capture: Path, sets: Sequence[str]) -> Truth:
    """The union of mask sets, undistorted by the reader of photos."""
    with tempfile.TemporaryDirectory() as folder:
        loaded = [_as_photos(capture, each, Path(folder)) for each in sets]
    masks = [torch.stack(views).any(0) for views in zip(*(masks for _, masks in loaded))]
    return Truth(loaded[0][0], tuple(masks))


def _as_photos(
    capture: Path, name: str, folder: Path
) -> tuple[tuple[Camera, ...], list[Bool[Tensor, "h w"]]]:
    """Cameras and masks of one set: a dataset whose photos are the masks."""
    record = json.loads((capture / "transforms.json").read_text())
    files = {each.stem: each for each in (capture / "masks" / name).glob("*.png")}
    frames = [f for f in record["frames"] if Path(f["file_path"]).stem in files]
    here = folder / name
    here.mkdir()
    for frame in frames:
        file = files[Path(frame["file_path"]).stem]
        frame["file_path"] = file.name
        copyfile(file, here / file.name)
    kept = {key: value for key, value in record.items() if key != "ply_file_path"}
    (here / "transforms.json").write_text(json.dumps({**kept, "frames": frames}))
    views = load_dataset(here).views
    return tuple(v.camera for v in views), [v.image.mean(-1) > 0.5 for v in views]


def middle(mask: Bool[Tensor, "h w"]) -> tuple[float, float]:
    """Column and row of the pixel of a mask that is nearest to its middle."""
    at = mask.nonzero().double()
    best = at[(at - at.median(0).values).norm(dim=1).argmin()]
    return float(best[1]) + 0.5, float(best[0]) + 0.5


@torch.no_grad()
def rows_of(capture: Path, path: Path) -> Iterator[list[str]]:
    """A row for each way to find the subject of a scene."""
    scene = load(path)
    viewpoints = viewpoints_of(load_dataset(capture))
    cameras = [each.camera for each in viewpoints]
    truth = read_truth(capture, WANTED[capture.name])
    clicks = [Click(truth.cameras[0], *middle(truth.masks[0]))]
    phrase = PHRASES[capture.name]
    ways = {
        "auto": lambda: find_subject(scene, cameras),
        "one click": lambda: Selector(scene, cameras).at(clicks),
        phrase: lambda: Finder(scene, viewpoints).named(phrase),
    }
    for way, find in ways.items():
        start = time.perf_counter()
        region = find()
        seconds = time.perf_counter() - start
        each = truth.iou(region, scene)
        numbers = (sum(each) / len(each), min(each), *truth.rim(region, scene))
        told = [f"{x:.3f}" for x in numbers] + [f"{truth.leak(region, scene):.1f}"]
        yield [capture.name, path.stem, way, *told, f"{seconds:.1f}", region.note]


def main(data: Path, out: Path, scenes: Sequence[Path]) -> None:
    """Write the table. A scene's file is named after its capture, as bear-draft.ply."""
    with out.open("w", newline="") as file:
        table = csv.writer(file)
        numbers = ("IoU", "least IoU", "bare", "spilt", "outside, dB", "s")
        table.writerow(("capture", "fit", "way", *numbers, "found"))
        for path in scenes:
            for row in rows_of(data / path.stem.split("-")[0], path):
                table.writerow(row)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), [Path(each) for each in sys.argv[3:]])
