"""The solve of colors on finished edits: which choice brings a scene nearer to what was asked for.

    python -m research.study_solve OUT.jsonl [EDIT_FOLDER ...]

Each folder is one of `gsedit edit --held-out-edits 8`, whose targets, region and edits of held-out
views are solved for again; two synthetic edits are made here. A line holds the PSNR to the targets
and to the held-out edits, over the pixels that these change, and CPU seconds.
"""

from __future__ import annotations

import json
import math
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import torch
from jaxtyping import Bool
from torch import Tensor

import gsedit
from gsedit import Dataset, EditSettings, Gaussians
from gsedit.datasets.dataset import View, capture
from gsedit.datasets.view_list_files import read_view_list
from gsedit.datasets.view_pictures import read_view_pictures
from gsedit.editors import make_editor
from gsedit.fitting import color_map
from gsedit.fitting.optimizer import LOWEST_COLOR
from gsedit.fitting.solve import solve_colors
from gsedit.formats.edit_records import read_edit_record
from gsedit.select.region import read_flags
from gsedit.synthetic import SyntheticScene, surface_gaussians
from gsedit.synthetic.paint import checker, lit, mix, plain, waves
from gsedit.synthetic.shapes import box, union
from rasterizer import Camera, render
from rasterizer.camera import look_at
from rasterizer.numerics import color_to_sh

CHANGED = 0.02
"""Difference to the unedited picture, from which a pixel counts as changed."""
CHOICES = {
    **{f"{n} iterations": {"most_iterations": n, "least_gain_db": -9.0} for n in (1, 3, 5, 8, 20)},
    "as it is": {},
    "stop at 0.1 dB": {"least_gain_db": 0.1, "most_iterations": 20},
    "penalty 0.5": {"penalty": 0.5},
    "degree 0 alone": {"band_penalty": 1e9},
    "mean change instead of the map": {"mean": True},
}


@dataclass(frozen=True, eq=False)
class Case:
    """An edit whose colors are solved for."""

    scene: Gaussians
    targets: Sequence[View]
    held_out: Sequence[View]
    inside: Bool[Tensor, " n"]


def read_case(folder: Path) -> Case:
    """The case of an edit's folder."""
    scene = gsedit.load(read_edit_record(folder / "edit.json")["scene"])
    viewpoints = read_view_list(folder / "views.json").viewpoints
    targets, held_out = (
        [
            View(viewpoints[i].name, viewpoints[i].camera, picture)
            for i, picture in read_view_pictures(folder / name, viewpoints).items()
        ]
        for name in ("targets", "held_out")
    )
    return Case(scene, targets, held_out, read_flags(folder / "region.npy", len(scene)))


def room() -> Case:
    """A bare room at night, edited in views of one half and held out in the other."""
    hollow = box((1.3, 1.3, 0.8))
    coat = mix(
        mix(plain((0.75, 0.47, 0.54)), plain((0.74, 0.32, 0.78)), checker(0.7)),
        plain((0.42, 0.86, 0.64)),
        waves(1.1),
    )

    def solid(points: Tensor) -> Tensor:
        return -hollow(points)

    up, black = torch.tensor((0, 0, 1.0)).double(), torch.zeros(3).double()
    shone = lit(coat, solid, (-0.3, -0.4, 0.9))
    scene = SyntheticScene("room", solid, shone, black, 2.0, up)
    gaussians = surface_gaussians(scene, 14_000, torch.Generator().manual_seed(0))
    turns = [math.pi if i % 8 == 0 else (i / 16 - 0.5) * 1.2 for i in range(16)]
    cameras = []
    for i, turn in enumerate(turns):
        eye = torch.tensor((-0.3 * math.cos(turn), 0.15 * math.sin(3 * i), 0.1)).double()
        ahead = torch.tensor((math.cos(turn), math.sin(turn), -0.1)).double()
        cameras.append(look_at(eye, eye + ahead, up, 75, 160, 160))
    return _edited(gaussians, cameras, "make it night", "all")


def statue() -> Case:
    """A dark subject, seen from the front only, in three half-transparent layers: white marble."""
    subject = box((0.35, 0.45, 0.6), 0.2)
    wall, up = box((3.0, 3.0, 0.05)), torch.tensor((0, 0, 1.0)).double()

    def floor(points: Tensor) -> Tensor:
        return wall(points + points.new_tensor((0, 0, 0.7)))

    solid, black = union(subject, floor), torch.zeros(3).double()
    coat = mix(plain((0.06, 0.05, 0.04)), plain((0.12, 0.09, 0.08)), waves(0.3))
    scene = SyntheticScene("statue", solid, lit(coat, solid, (0.5, 0.4, 0.8)), black, 2.6, up)
    surface = surface_gaussians(scene, 12_000, torch.Generator().manual_seed(0))
    draw = torch.Generator().manual_seed(1)
    layers = [
        replace(
            surface,
            means=surface.means + 0.012 * torch.randn(surface.means.shape, generator=draw),
            sh=surface.sh + 0.15 * torch.randn(surface.sh.shape, generator=draw),
            logit_opacities=torch.full_like(surface.logit_opacities, 0.3),
        )
        for _ in range(3)
    ]
    gaussians = Gaussians(
        *(torch.cat([getattr(each, name) for each in layers]) for name in vars(surface))
    )
    angles = [(i / 16 - 0.5) * 0.9 for i in range(17)]
    eyes = [torch.tensor((2.4 * math.cos(a), 2.4 * math.sin(a), 0.4)).double() for a in angles]
    cameras = [look_at(eye, torch.zeros(3).double(), up, 50, 192, 192) for eye in eyes]
    return _edited(gaussians, cameras, "turn it into a white marble statue", "box:-1,-1,-0.6,1,1,2")


def _edited(scene: Gaussians, cameras: list[Camera], sentence: str, region: str) -> Case:
    names = [f"{i:02d}" for i in range(len(cameras))]
    result = gsedit.edit(
        with_bands(scene),
        sentence,
        editor=make_editor("small"),
        dataset=Dataset(capture(scene, cameras, names)),
        settings=EditSettings(region=region, held_out_edits=3, batches=3),
    )
    return Case(with_bands(scene), result.targets, result.held_out.edited, result.region.inside)


def with_bands(scene: Gaussians) -> Gaussians:
    """The scene with harmonics of degree 1, as fitted scenes have them."""
    missing = max(0, 4 - scene.sh.shape[1])
    return replace(scene, sh=torch.cat((scene.sh, scene.sh.new_zeros(len(scene), missing, 3)), 1))


def decibels(scene: Gaussians, before: Gaussians, views: Sequence[View]) -> float:
    """Mean PSNR to the views, over the pixels that they change."""
    found = []
    for view in views:
        now, then = (render(each, view.camera).color.clamp(0, 1) for each in (scene, before))
        changed = (view.image - then).abs().amax(-1) > CHANGED
        found.append(-10 * (now - view.image)[changed].square().mean().log10())
    return float(torch.stack(found).mean())


def measured(case: Case) -> Iterator[dict[str, object]]:
    """A record for every choice."""
    lowest, base = color_to_sh(LOWEST_COLOR), case.scene.sh[:, :1]
    base = torch.where(case.inside[:, None, None], base.clamp_min(lowest), base)
    raised = replace(case.scene, sh=torch.cat((base, case.scene.sh[:, 1:]), 1))
    for name, given in CHOICES.items():
        options = dict(given)
        color_map.RIDGE = 1e9 if options.pop("mean", False) else RIDGE
        began = time.process_time()
        *_, last = solved = list(solve_colors(raised, case.targets, case.inside, **options))
        seconds = time.process_time() - began
        yield {
            "choice": name,
            "iterations": len(solved),
            "targets": round(decibels(last.scene, case.scene, case.targets), 2),
            "held_out": round(decibels(last.scene, case.scene, case.held_out), 2),
            "cpu_seconds": round(seconds, 1),
        }


RIDGE = color_map.RIDGE

if __name__ == "__main__":
    out, *folders = map(Path, sys.argv[1:])
    cases = {folder.name: read_case(folder) for folder in folders}
    cases |= {"room": room(), "statue": statue()}
    with out.open("w") as file:
        for name, case in cases.items():
            for record in measured(case):
                file.write(json.dumps({"case": name, **record}) + "\n")
                file.flush()
