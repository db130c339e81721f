"""Metal, gloss and paint in a scene's light against exact pictures, at cameras not used.

    python -m research.measure_materials [--small] > docs/measurements/data/materials.csv

A stone bear in a garden of known light, captured from 36 cameras that look down on it: its sky is
not seen, and its sun is clipped. The exact pictures are traced from four other cameras. Each
material is put on by its route, as paint of its color by the route "paint", and with --small by the
editor `small`.
"""

from __future__ import annotations

import csv
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time

import numpy as np
import torch

import gsedit
from gsedit.datasets.dataset import Dataset, capture
from gsedit.editing.routes.apply import apply_change, seen_weights
from gsedit.editing.session.settings import EditSettings
from gsedit.materials.apply import in_material
from gsedit.materials.material import Material
from gsedit.measures.color_difference import ciede2000
from gsedit.regions.region import Region, save_region
from gsedit.scene.color_space import lab_of_srgb, srgb_of_hex
from gsedit.scene.picture import render_picture
from gsedit.synthetic import SyntheticScene, demo_scene, ring_cameras
from gsedit.synthetic.gallery import bear_fur
from gsedit.synthetic.reflective import Finish, LitSolid, captured, garden, plain_base
from gsedit.words.instruction import Change
from rasterizer.camera import Camera
from rasterizer.scene import Gaussians

SIZE = 96
COUNT, DOME = 12_000, 12_000
SAMPLES = 16
METALS = {"bronze": 0.38, "gold": 0.22, "silver": 0.2, "chrome": 0.06}
COLORS = {"bronze": "#b98550", "gold": "#ffd76b", "silver": "#f4f3f0", "chrome": "#dfe3e6"}
PAINTS = ("#653700", "#029386", "#e50000", "#ffffff", "#0343df", "#808080", "#fac205", "#15b01a")
PROMPTS = {"bronze": "turn it into a bronze statue", "gold": "turn it into a golden statue",
           "silver": "turn it into a silver statue"}  # fmt: skip
COLUMNS = ("material", "by", "PSNR dB, whole picture", "PSNR dB, subject", "CIEDE2000 of the mean",
           "CPU s")  # fmt: skip


def cases() -> dict[str, tuple[Finish, Material]]:
    """Exact finishes, and the materials that stand for them, by name."""
    found = {}
    for name, roughness in METALS.items():
        base = plain_base(srgb_of_hex(COLORS[name]).tolist())
        found[name] = (Finish(base, 1.0, roughness), Material(COLORS[name], 1.0, roughness))
    red = "#b30d0d"
    found["glossy red"] = (
        Finish(plain_base(srgb_of_hex(red).tolist()), 0.0, 0.15), Material(red, 0.0, 0.15)
    )  # fmt: skip
    for color in PAINTS:
        matte = Finish(plain_base(srgb_of_hex(color).tolist()), specular=0.0)
        found[f"paint {color}"] = (matte, Material(color, roughness=1.0, specular=0.0))
    return found


def bear() -> LitSolid:
    """The demo's bear, without its clothes, in a garden."""
    demo = demo_scene()
    solid = SyntheticScene("bear", bear_fur(), demo.albedo, demo.background, 1.0, demo.up)
    return LitSolid(solid, garden)


def measured(
    scene: Gaussians, cameras: tuple[Camera, ...], exact: list[torch.Tensor], lit: LitSolid
) -> tuple[float, float, float]:
    """(PSNR of pictures, PSNR on the subject, CIEDE2000 of the subject's mean color)."""
    shown = [render_picture(scene, camera).double() for camera in cameras]
    hits = [lit.solid.trace(camera).hit for camera in cameras]
    errors = [(a - b).square() for a, b in zip(shown, exact)]
    whole = -10 * np.log10(np.mean([float(e.mean()) for e in errors]))
    on = -10 * np.log10(float(torch.cat([e[hit] for e, hit in zip(errors, hits)]).mean()))
    means = [torch.cat([p[hit] for p, hit in zip(each, hits)]).mean(0) for each in (shown, exact)]
    labs = [lab_of_srgb(mean.numpy()[None]) for mean in means]
    return float(whole), float(on), float(ciede2000(*labs)[0])


def by_small(
    scene: Gaussians, own: torch.Tensor, prompt: str, cameras: tuple[Camera, ...]
) -> Gaussians:
    """The scene as the editor `small` and the pipeline make it, in the exact region."""
    views = capture(scene, cameras, [f"view_{i:03d}" for i in range(len(cameras))])
    with TemporaryDirectory() as folder:
        save_region(Region(own), file := Path(folder) / "own.npy")
        settings = EditSettings(region=str(file))
        return gsedit.edit(scene, prompt, dataset=Dataset(views), settings=settings).scene


def main(arguments: list[str]) -> None:
    """Write the table as CSV, and the median over paints to the error stream."""
    lit = bear()
    rings = ((0.0, -90.0), (25.0, -80.0), (50.0, -70.0))
    used = [c for up, start in rings
            for c in ring_cameras(lit.solid, 12, SIZE, elevation=up, start=start)]  # fmt: skip
    held_out = (*ring_cameras(lit.solid, 3, SIZE, elevation=10.0, start=-75.0),
                ring_cameras(lit.solid, 3, SIZE, elevation=40.0, start=-40.0)[0])  # fmt: skip
    stone = Finish(plain_base((0.5, 0.45, 0.4)), specular=0.0)
    scene, own = captured(lit, stone, COUNT, DOME, torch.Generator().manual_seed(0))
    seen = seen_weights(scene, used)
    table = csv.writer(sys.stdout, lineterminator="\n")
    table.writerow(COLUMNS)
    differences = []
    for name, (finish, material) in cases().items():
        exact = [lit.photograph(finish, camera, SAMPLES) for camera in held_out]
        start = process_time()
        made = in_material(scene, own, material, used, weights=seen).scene
        seconds = process_time() - start
        row = measured(made, held_out, exact, lit)
        table.writerow([name, "material", *(f"{each:.1f}" for each in row), f"{seconds:.1f}"])
        if name.startswith("paint"):
            differences.append(row[2])
            continue
        flat = Change("subject", "paint", "", material.color, None, "paint")
        row = measured(apply_change(scene, flat, Region(own), seen, used), held_out, exact, lit)
        table.writerow([name, "paint", *(f"{each:.1f}" for each in row), ""])
        if "--small" in arguments and name in PROMPTS:
            start = process_time()
            edited = by_small(scene, own, PROMPTS[name], tuple(used))
            seconds = process_time() - start
            row = measured(edited, held_out, exact, lit)
            table.writerow([name, "small", *(f"{each:.1f}" for each in row), f"{seconds:.1f}"])
        sys.stdout.flush()
    sys.stderr.write(f"median CIEDE2000 of paints: {np.median(differences):.1f}\n")


if __name__ == "__main__":
    main(sys.argv[1:])
