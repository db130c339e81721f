"""Metal, gloss, marble and paint in a scene's light against exact pictures, at cameras not used.

    python -m research.measure_materials materials.csv > materials.md

A stone bear in a garden, captured from 36 cameras that look down on it: its sky is not seen, and
its sun is clipped. A stone armchair in a room with windows and a lamp. The light of both is known,
and exact pictures are traced from four other cameras. Each material is put on by its route and, but
for matte paint, as paint of its color by the route "paint"; bronze and gold also by the editor
`small`, and as SH of degree 3 of the exact light at exact points: the ceiling. Pictures are means
of two by two pixels. All numbers go to a CSV as they come, a table of Markdown to the output.
"""

from __future__ import annotations

import csv
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time
from typing import NamedTuple

import numpy as np
import torch
from bench.reflective import (
    Finish,
    LitSolid,
    captured,
    display,
    garden,
    plain_base,
    room,
)

import gsedit
from gsedit.datasets.dataset import Dataset, capture
from gsedit.editing.routes.apply import apply_change, seen_weights
from gsedit.editing.session.settings import EditSettings
from gsedit.editors import make_editor
from gsedit.materials.apply import AROUND, in_material, view_weights
from gsedit.materials.harmonics import fitted
from gsedit.materials.material import Layer, Material
from gsedit.materials.patterns import Ground, share_of
from gsedit.measures.color_difference import ciede2000
from gsedit.scene.color_space import lab_of_srgb, srgb_of_hex
from gsedit.scene.picture import render_picture
from gsedit.scene.quaternions import even_directions
from gsedit.select.region import Region, save_region
from gsedit.surface.surroundings import middle
from gsedit.synthetic import SyntheticScene, demo_scene, ring_cameras
from gsedit.synthetic.gallery import bear_fur
from gsedit.synthetic.shapes import (
    box,
    capsule,
    gradient,
    mirror,
    rotate,
    smooth_union,
    translate,
    union,
)
from gsedit.synthetic.splats import surface_points
from gsedit.words.instruction import Change
from rasterizer.camera import Camera
from rasterizer.scene import Gaussians

SIZE = 96
COUNT, DOME = 12_000, 12_000
SAMPLES = 16
CEILING_SAMPLES = 4
AT_ONCE = 1000
METALS = {"bronze": 0.38, "gold": 0.22, "silver": 0.2, "chrome": 0.06}
COLORS = {"bronze": "#b98550", "gold": "#ffd76b", "silver": "#f4f3f0", "chrome": "#dfe3e6"}
MARBLE = Material("#f1efeb", 0.0, 0.2, layers=(Layer("veins", "#6f7076", 0.2, 0.7, roughness=0.2),))
"""Polished stone with veins, without the translucency and the coat that exact pictures have not."""
PAINTS = ("#653700", "#029386", "#e50000", "#ffffff", "#0343df", "#808080", "#fac205", "#15b01a")
PROMPTS = {"bronze": "turn it into a bronze statue", "gold": "turn it into a golden statue"}
COLUMNS = ("scene", "material", "by", "PSNR dB, whole picture", "PSNR dB, subject",
           "CIEDE2000 of the mean", "CPU s")  # fmt: skip
BY = ("material", "paint", "small", "ceiling")


class Row(NamedTuple):
    """One way to a material on one scene, against exact pictures; see COLUMNS."""

    scene: str
    material: str
    by: str
    whole: float
    subject: float
    difference: float
    seconds: float


def cases(veins: Callable[[torch.Tensor], torch.Tensor]) -> dict[str, tuple[Finish, Material]]:
    """Exact finishes, and the materials that stand for them, by name; `veins` colors marble."""
    found = {}
    for name, roughness in METALS.items():
        found[name] = (Finish(base_of(COLORS[name]), 1.0, roughness),
                       Material(COLORS[name], 1.0, roughness))  # fmt: skip
    red = "#b30d0d"
    found["glossy red"] = (Finish(base_of(red), 0.0, 0.15), Material(red, 0.0, 0.15))
    found["marble"] = Finish(veins, 0.0, 0.2), MARBLE
    for color in PAINTS:
        matte = Finish(base_of(color), specular=0.0)
        found[f"paint {color}"] = (matte, Material(color, roughness=1.0, specular=0.0))
    return found


def base_of(color: str) -> Callable[[torch.Tensor], torch.Tensor]:
    """The base color "#rrggbb" everywhere."""
    return plain_base(srgb_of_hex(color).tolist())


def veined(scene: Gaussians, own: torch.Tensor) -> Callable[[torch.Tensor], torch.Tensor]:
    """Exact base color of MARBLE at points: its veins in space, on their share of the subject."""
    center, radius = middle(scene, own)
    known = (scene.means[own] - center) / radius
    stone, vein = (base_of(each)(known[:1]) for each in (MARBLE.color, MARBLE.layers[0].color))

    def base(points: torch.Tensor) -> torch.Tensor:
        places = torch.cat((known, (points.float() - center) / radius))
        share = share_of(MARBLE.layers[0], Ground(places, places, places[:, 0]))[len(known) :]
        return torch.lerp(stone, vein, share[:, None].float()).to(points)

    return base


def bear() -> LitSolid:
    """The demo's bear, without its clothes, in a garden."""
    demo = demo_scene()
    solid = SyntheticScene("bear", bear_fur(), demo.albedo, demo.background, 1.0, demo.up)
    return LitSolid(solid, garden)


def armchair() -> LitSolid:
    """An armchair, all corners and flats, in a room."""
    seat = translate(box((0.5, 0.45, 0.16), 0.08), (0, 0, -0.3))
    back = translate(rotate(box((0.5, 0.12, 0.55), 0.1), (1, 0, 0), -12.0), (0, 0.42, 0.15))
    arms = mirror(translate(box((0.13, 0.45, 0.3), 0.1), (0.5, 0, -0.12)))
    front = capsule((0.48, -0.34, -0.4), (0.5, -0.36, -0.75), 0.06)
    legs = mirror(union(front, capsule((0.48, 0.34, -0.4), (0.5, 0.36, -0.75), 0.06)))
    demo = demo_scene()
    sdf = smooth_union(0.06, seat, back, arms, legs)
    solid = SyntheticScene("armchair", sdf, demo.albedo, demo.background, 1.0, demo.up)
    return LitSolid(solid, room)


def ceiling(
    scene: Gaussians, own: torch.Tensor, lit: LitSolid, finish: Finish, cameras: list[Camera]
) -> Gaussians:
    """The scene with SH of degree 3 of the exact light that points of the subject send."""
    points = surface_points(lit.solid, COUNT, torch.Generator().manual_seed(0))
    normals = torch.nn.functional.normalize(gradient(lit.solid.sdf, points), dim=-1)
    eyes = torch.stack([camera.center for camera in cameras])
    directions = torch.from_numpy(even_directions(AROUND)).to(points)
    found = []
    for p, n in zip(points.split(AT_ONCE), normals.split(AT_ONCE)):
        weights = view_weights(p, n, directions, eyes)
        at, way = (weights > 0).nonzero().unbind(-1)
        shown = p.new_full((*weights.shape, 3), 0.5)
        sent = lit.outgoing(finish, p[at], n[at], directions[way], CEILING_SAMPLES)
        shown[at, way] = display(sent)
        found.append(fitted(shown, -directions, weights, 3))
    sh = scene.sh.new_zeros(len(scene), 16, 3)
    sh[:, :1] = scene.sh
    sh[own] = torch.cat(found).to(sh)
    return replace(scene, sh=sh)


def picture(scene: Gaussians, camera: Camera) -> torch.Tensor:
    """The scene's picture, the mean of two by two pixels of one of twice the size."""
    fine = render_picture(scene, camera.resized(2 * camera.width, 2 * camera.height)).double()
    return fine.reshape(camera.height, 2, camera.width, 2, 3).mean((1, 3))


def measured(
    scene: Gaussians, cameras: tuple[Camera, ...], exact: list[torch.Tensor], lit: LitSolid
) -> tuple[float, float, float]:
    """(PSNR of pictures, PSNR on the subject, CIEDE2000 of the subject's mean color)."""
    shown = [picture(scene, camera) for camera in cameras]
    hits = [lit.solid.trace(camera).hit for camera in cameras]
    errors = [(a - b).square() for a, b in zip(shown, exact)]
    whole = -10 * np.log10(np.mean([float(e.mean()) for e in errors]))
    on = -10 * np.log10(float(torch.cat([e[hit] for e, hit in zip(errors, hits)]).mean()))
    means = [torch.cat([p[hit] for p, hit in zip(each, hits)]).mean(0) for each in (shown, exact)]
    labs = [lab_of_srgb(mean.numpy()[None]) for mean in means]
    return float(whole), float(on), float(ciede2000(*labs)[0])


def by_small(scene: Gaussians, own: torch.Tensor, prompt: str, cameras: list[Camera]) -> Gaussians:
    """The scene as the editor `small` and the pipeline make it, in the exact region."""
    views = capture(scene, cameras, [f"view_{i:03d}" for i in range(len(cameras))])
    with TemporaryDirectory() as folder:
        save_region(Region(own), file := Path(folder) / "own.npy")
        settings = EditSettings(region=str(file))
        return gsedit.edit(
            scene, prompt, editor=make_editor("small"), dataset=Dataset(views), settings=settings
        ).scene


def dressed(
    scene: Gaussians,
    own: torch.Tensor,
    material: Material,
    cameras: list[Camera],
    seen: torch.Tensor | None,
) -> Gaussians:
    """The scene with the subject in a material."""
    return in_material(scene, own, material, cameras, weights=seen).scene


def painted(
    scene: Gaussians,
    own: torch.Tensor,
    material: Material,
    cameras: list[Camera],
    seen: torch.Tensor | None,
) -> Gaussians:
    """The scene with the subject in paint of a material's color."""
    flat = Change("subject", "paint", "", material.color, None, "paint")
    return apply_change(scene, flat, Region(own), seen, cameras)


def measure(lit: LitSolid) -> Iterator[Row]:
    """Yield the rows of one scene."""
    rings = ((0.0, -90.0), (25.0, -80.0), (50.0, -70.0))
    used = [c for up, start in rings
            for c in ring_cameras(lit.solid, 12, SIZE, elevation=up, start=start)]  # fmt: skip
    held_out = (*ring_cameras(lit.solid, 3, SIZE, elevation=10.0, start=-75.0),
                ring_cameras(lit.solid, 3, SIZE, elevation=40.0, start=-40.0)[0])  # fmt: skip
    stone = Finish(plain_base((0.5, 0.45, 0.4)), specular=0.0)
    scene, own = captured(lit, stone, COUNT, DOME, torch.Generator().manual_seed(0))
    seen = seen_weights(scene, used)
    for case, (finish, material) in cases(veined(scene, own)).items():
        exact = [lit.photograph(finish, camera, SAMPLES) for camera in held_out]
        makers = {"material": partial(dressed, scene, own, material, used, seen)}
        if not case.startswith("paint"):
            makers["paint"] = partial(painted, scene, own, material, used, seen)
        if case in PROMPTS:
            makers["small"] = partial(by_small, scene, own, PROMPTS[case], used)
            makers["ceiling"] = partial(ceiling, scene, own, lit, finish, used)
        for by, make in makers.items():
            start = process_time()
            made = make()
            seconds = process_time() - start
            yield Row(lit.solid.name, case, by, *measured(made, held_out, exact, lit), seconds)


def markdown(rows: Sequence[Row]) -> str:
    """Whole pictures' PSNR of each way, and the material's mean color and time, as a table."""
    lines = [f"| scene | finish | {' | '.join(BY)} | CIEDE2000 | CPU s |", "|---" * 8 + "|"]
    for own in (row for row in rows if row.by == "material"):
        ways = {row.by: f"{row.whole:.1f}" for row in rows if row[:2] == own[:2]}
        cells = [own.scene, own.material, *(ways.get(by, "") for by in BY)]
        lines.append(f"| {' | '.join(cells)} | {own.difference:.1f} | {own.seconds:.1f} |")
    return "\n".join(lines) + "\n"


def main(file: Path) -> None:
    """Measure both scenes, into a CSV and a table."""
    rows: list[Row] = []
    with file.open("w", newline="") as stream:
        table = csv.writer(stream, lineterminator="\n")
        table.writerow(COLUMNS)
        for lit in (bear(), armchair()):
            for row in measure(lit):
                table.writerow([*row[:3], *(f"{each:.1f}" for each in row[3:])])
                stream.flush()
                rows.append(row)
    sys.stdout.write(markdown(rows))
    for name in dict.fromkeys(row.scene for row in rows):
        paints = [r.difference for r in rows if r.scene == name and r.material[:5] == "paint"]
        sys.stdout.write(f"\n{name}: median CIEDE2000 of paints {np.median(paints):.1f}\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
