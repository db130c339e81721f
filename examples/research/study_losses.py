"""Effect of Gram, its features and the random switch where targets contradict each other.

Every second target is shifted by half a latent cell (4 pixels), as if the editor had placed it
wrongly. One line of JSON a run: error to the true edit at held-out cameras, gradient energy
(1 is as sharp as the truth), seconds of the update.

python -m research.study_losses OUT.jsonl                      # synthetic: the true edit is exact
python -m research.study_losses OUT.jsonl bear.ply photos/     # a capture, closed-form editor
"""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import torch
import torch.nn.functional as F

import gsedit
from gsedit.datasets.dataset import Dataset, capture
from gsedit.editing.strategies.single_pass import SinglePass
from gsedit.editor_protocol import Capabilities, Editor, EditProgress
from gsedit.editors import make_editor
from gsedit.fitting.settings import UpdateSettings
from gsedit.measures import metrics
from gsedit.measures.features import FilterBank
from gsedit.measures.perceptual import vgg_features
from gsedit.synthetic import demo_scene, ring_cameras, surface_gaussians
from research.loss_switch import SwitchedUpdate

ARMS = {
    "MSE": (0.0, 0.0, "filters"),
    "0.1 Gram, filters": (0.1, 0.0, "filters"),
    "30 Gram, filters": (30.0, 0.0, "filters"),
    "100 Gram, filters": (100.0, 0.0, "filters"),
    "300 Gram, filters": (300.0, 0.0, "filters"),
    "switch, 30 Gram, filters": (30.0, 0.5, "filters"),
    "30 Gram, VGG": (30.0, 0.0, "vgg"),
    "switch, 30 Gram, VGG": (30.0, 0.5, "vgg"),
}
"""(Gram weight, probability of the switch, features)."""


class Permuted:
    """Red, green and blue change places: a scene of Gaussians can follow that exactly."""

    name, cell = "permuted", 8
    capabilities = Capabilities(
        find_ground_truth=lambda *batch: lambda pictures: pictures[..., [2, 0, 1]]
    )

    def check(self, prompt):
        """Every instruction is as good."""

    def edit(self, batch, settings, generator):
        yield EditProgress(1, 1, batch.originals[..., [2, 0, 1]])


@dataclass(frozen=True, eq=False)
class Shifted:
    """An editor whose pictures are moved by `pixels`, every second one, along a random axis."""

    editor: Editor
    pixels: int
    seed: int
    cell = 8

    @property
    def name(self):
        return self.editor.name

    @property
    def capabilities(self):
        return replace(self.editor.capabilities, denoiser=None)

    def check(self, prompt):
        self.editor.check(prompt)

    def edit(self, batch, settings, generator):
        draws = torch.Generator().manual_seed(self.seed)
        for progress in self.editor.edit(batch, settings, generator):
            images = progress.images
            if images is not None:
                images = images.clone()
                for i in range(0, len(images), 2):
                    way = int(torch.randint(4, (), generator=draws))
                    images[i] = moved(images[i], self.pixels, way)
            yield replace(progress, images=images)


def moved(image, pixels, way):
    """The picture shifted right, down, left or up; its border is repeated."""
    p = pixels
    wide = F.pad(image.movedim(-1, 0)[None], (p,) * 4, mode="replicate")[0].movedim(0, -1)
    left, top = ((0, p), (p, 0), (2 * p, p), (p, 2 * p))[way] if p else (0, 0)
    return wide[top : top + image.shape[0], left : left + image.shape[1]]


def gradient_energy(images):
    """Mean squared difference of neighboring pixels."""
    return sum(images.diff(dim=axis).square().mean().item() for axis in (1, 2))


def run(scene, data, editor, arm, seed, pixels, steps):
    """One edit; what came out at the held-out cameras."""
    weight, switch, features = ARMS[arm]
    patch = min(64, data.views[0].camera.width // 2)
    loss = f"mse+{weight:g}*gram"
    update = UpdateSettings(patch=patch, loss=loss)
    if switch:
        update = SwitchedUpdate(patch=patch, loss=loss, switch=switch)
    settings = gsedit.EditSettings(
        update=update,
        views_per_batch=8,
        batches=1,
        held_out_edits=0,
    )
    result = gsedit.edit(
        scene,
        "as a bronze statue",
        editor=Shifted(editor, pixels, seed),
        dataset=data,
        settings=settings,
        strategy=SinglePass(steps),
        features=FilterBank() if features == "filters" else vgg_features(),
        generator=torch.Generator().manual_seed(seed),
    )
    edited, before = (torch.stack([v.image for v in x]) for x in (result.targets, result.originals))
    truth = editor.capabilities.find_ground_truth("as a bronze statue", edited, before)
    cameras = [view.camera for view in data.split()[1]]
    names = [""] * len(cameras)
    expected = truth(torch.stack([v.image for v in capture(scene, cameras, names)]))
    renders = torch.stack([v.image for v in capture(result.scene, cameras, names)])
    return {
        "psnr": metrics.psnr(renders, expected),
        "ssim": metrics.ssim(renders, expected),
        "perceptual": metrics.perceptual(renders, expected),
        "gradient": gradient_energy(renders) / gradient_energy(expected),
        "seconds": result.timings["update"],
    }


def main(out: str, scene_path: str = "", photos: str = "", seeds: int = 3) -> None:
    steps = 200 if scene_path else 120
    if scene_path:
        scene, data = gsedit.load(scene_path), gsedit.load_dataset(photos, size=192)
        editor = make_editor("closed-form")
    else:
        scene = surface_gaussians(demo_scene(), 3000, torch.Generator().manual_seed(0))
        cameras = ring_cameras(demo_scene(), 24, 96)
        data = Dataset(capture(scene, cameras, [f"{i:02d}" for i in range(24)]))
        editor = Permuted()
    lines = Path(out).read_text().splitlines() if Path(out).exists() else []
    done = {tuple(json.loads(line)[k] for k in ("seed", "pixels", "arm")) for line in lines}
    runs = [run for run in product(range(seeds), (4, 0), ARMS) if run not in done]
    for seed, pixels, arm in sorted(runs, key=lambda run: ("VGG" in run[2], run[0], run[1] == 0)):
        if seed and (pixels == 0 or "VGG" in arm):
            continue  # one seed: consistent targets, and VGG, which takes six times as long
        measured = run(scene, data, editor, arm, seed, pixels, steps)
        with Path(out).open("a") as file:
            file.write(json.dumps({"arm": arm, "seed": seed, "pixels": pixels, **measured}) + "\n")


if __name__ == "__main__":
    if len(sys.argv) not in (2, 4):
        sys.exit(__doc__)
    out, *capture_files = sys.argv[1:]
    scene, photos = capture_files or ("", "")
    main(out, scene, photos)
