"""The sheet of the world: captures and splats, each after sixteen sentences, beside themselves.

python examples/world_sheet.py bear.ply garden.ply dinosaur.ply guitar.ply -o sheet/

Every picture is of a camera that no edit looked through; of a copy, of that which sees most of it.
sheet/ gets a folder of pictures a scene,
before and after; sheet.jpg, all of them; and larger, front.jpg, some of the first three scenes;
front.webp, these moving; and objects.jpg, the first scene, which shows a bear, after OBJECTS.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate
from pathlib import Path

import numpy as np
import torch
from PIL import Image, ImageDraw, ImageFont

import gsedit
from gsedit.editing.edit import change_steps
from gsedit.editing.plan import read_steps
from gsedit.errors import GseditError
from gsedit.formats.pictures import as_picture
from gsedit.run.events import returned
from gsedit.select.finder import Finder
from gsedit.views.around import find_viewpoints
from gsedit.views.cameras_json import cameras_file, read_cameras
from gsedit.views.paths import circle_of, swing
from gsedit.views.view_list_files import HELD_OUT_EVERY
from gsedit.views.viewpoints import Viewpoint, rendered, same_size, thinned
from rasterizer.camera import Camera
from rasterizer.render import render
from rasterizer.scene import Gaussians

INSTRUCTIONS = (
    "turn it into a bronze statue",
    "polished white marble",
    "solid gold",
    "rusty iron",
    "cover it with moss",
    "paint it matte teal",
    "make it snow",
    "autumn",
    "at night by moonlight",
    "sunset from the left",
    "a foggy morning",
    "remove it",
    "make it half as big",
    "put a copy of it beside it",
    "draw it in pencil",
    "as an expressionist painting",
)
"""Sentences about the subject, the scene, objects and pictures."""
DRAWN, COPIED = len(INSTRUCTIONS) - 2, len(INSTRUCTIONS) - 3
"""First instruction that the painter draws, and that of a copy."""
FRONT = (("turn it into a bronze statue", "at night by moonlight"),
         ("make it snow", "polished white marble"),
         ("as an expressionist painting", "remove it"))  # fmt: skip
"""Instructions of the front picture, for each of the first three scenes."""
MOVING = "turn it into a bronze statue", "as an expressionist painting", "rusty iron"
"""Those of the moving pictures."""
OBJECTS = ("remove the bear", "make the bear half the size", "turn the bear around",
           "a thick layer of snow on the bear", "let moss grow on the bear",
           "cover the ground with fallen leaves", "remove the bear and make it night")  # fmt: skip
VIEW_PIXELS = 256
"""Longer side of the views that edits look at."""
CELL_PIXELS, FRONT_PIXELS, PAIR_PIXELS = 200, 320, 512
"""Heights of pictures, pixels: in the sheet, the front picture, of before and after."""
LABEL_PIXELS, GAP = 18, 2
MOVING_PIXELS, FRAMES, FPS, ARC = 300, 46, 12.0, 40.0  # ARC: degrees of a swing


@dataclass(frozen=True, eq=False)
class Shown:
    """A scene, the views that edits look at, and the camera of its pictures."""

    name: str
    scene: Gaussians
    viewpoints: tuple[Viewpoint, ...]
    camera: Camera
    held_out: tuple[Camera, ...]

    def facing(self, made: Gaussians) -> Camera:
        """The held-out camera that sees most of the Gaussians that a scene has more."""

        def seen(camera: Camera) -> int:
            rows = render(made, camera, median_depth=True).median_row
            return 0 if rows is None else len(rows[rows >= len(self.scene)].unique())

        return max(self.held_out, key=seen)


def show(name: str, scene: Gaussians, viewpoints: Sequence[Viewpoint]) -> Shown:
    """Choose the held-out camera that sees most of the subject, closer where little is seen.

    The first of the other cameras, which tells sides, is the nearest to it.
    """
    held_out = tuple(each.camera for each in viewpoints[::HELD_OUT_EVERY])
    used = [v for i, v in enumerate(viewpoints) if i % HELD_OUT_EVERY]
    with torch.no_grad():
        opaque = [render(scene, camera).alpha > 0.1 for camera in held_out]
    best = max(range(len(held_out)), key=lambda i: int(opaque[i].sum()))
    around = float(opaque[best].float().mean()) > 0.5
    if around:
        best = 0
    camera = held_out[best]
    used.sort(key=lambda v: float((v.camera.center - camera.center).norm()))
    camera = camera if around else closer(camera, opaque[best])
    return Shown(name, scene, tuple(used), camera, held_out)


def closer(camera: Camera, opaque: torch.Tensor) -> Camera:
    """The camera with what is opaque in the middle of a picture of about its proportions, filling
    94 % of it."""
    rows, columns = opaque.nonzero().unbind(-1)
    if not len(rows):
        return camera
    low_x, high_x = int(columns.min()), int(columns.max()) + 1
    low_y, high_y = int(rows.min()), int(rows.max()) + 1
    wide, high = high_x - low_x, high_y - low_y
    height = camera.height
    width = round(height * min(max(wide / high, 0.6), 1.4))
    zoom = 0.94 * min(width / wide, height / high)
    return replace(
        camera,
        fx=camera.fx * zoom,
        fy=camera.fy * zoom,
        cx=width / 2 + zoom * (camera.cx - (low_x + high_x) / 2),
        cy=height / 2 + zoom * (camera.cy - (low_y + high_y) / 2),
        width=width,
        height=height,
    )


def load_shown(path: Path) -> Shown:
    """A scene file with the cameras beside it, or found ones."""
    scene = gsedit.load(path)
    file = cameras_file(path)
    found = find_viewpoints(scene, 24, VIEW_PIXELS) if file is None else read_cameras(file)
    viewpoints = same_size(thinned(found), VIEW_PIXELS)
    return show(path.stem.split(".")[0], scene, viewpoints)


def moving(shown: Shown, edited: Gaussians | None) -> gsedit.Animation:
    """A scene seen in a swing, parted from the edited one by a line that moves."""
    path = swing(circle_of([each.camera for each in shown.viewpoints]), FRAMES, ARC)
    cameras = tuple(each.resized(MOVING_PIXELS, MOVING_PIXELS) for each in path)
    return gsedit.Animation(shown.scene, cameras, wiped=edited)


def edits(shown: Shown, instructions: Sequence[str]) -> Iterator[Gaussians | None]:
    """The scene after each instruction, as `gsedit edit` does it; None, with a line, for one that
    is refused. The subject is searched once."""
    finder = Finder(shown.scene, shown.viewpoints)
    for i, text in enumerate(instructions):
        say(f"{shown.name}: {text}")
        try:
            if i >= DRAWN:
                views = rendered(shown.scene, shown.viewpoints)
                yield gsedit.edit(shown.scene, text, views).scene
                continue
            yield returned(change_steps(finder, read_steps(text))).scene
        except GseditError as error:
            say(str(error))
            yield None


def cell(scene: Gaussians | None, camera: Camera, pixels: int) -> Image.Image:
    """A picture of a height; gray where there is no scene."""
    size = round(camera.width * pixels / camera.height), pixels
    if scene is None:
        return Image.new("RGB", size, "lightgray")
    with torch.no_grad():
        drawn = render(scene, camera.resized(*size))
    behind = 0.16 * (1 - drawn.alpha)[..., None]  # what is black is seen before gray
    return as_picture((drawn.color + behind).clamp(0, 1))


Labelled = tuple[str, Image.Image]


def grid(rows: Sequence[Sequence[Labelled]]) -> Image.Image:
    """Rows of pictures, each under its label; those of a row are as high, of a column as wide."""
    pixels = rows[0][0][1].height
    lefts = [0, *accumulate(picture.width + GAP for _, picture in rows[0])]
    height = pixels + LABEL_PIXELS
    sheet = Image.new("RGB", (lefts[-1] - GAP, height * len(rows)), "white")
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(13)
    for i, row in enumerate(rows):
        for left, (_, picture) in zip(lefts, row, strict=False):
            sheet.paste(picture, (left, i * height + LABEL_PIXELS))
        for left, (label, _) in zip(lefts, row, strict=False):
            draw.text((left + 3, i * height + 1), label, fill="black", font=font)
    return sheet


def front_row(
    shown: Shown, scenes: Sequence[Gaussians | None], wanted: Sequence[str]
) -> list[Labelled]:
    """The scene before and after the wanted edits."""
    chosen = [("before", scenes[0])]
    chosen += [(f'"{text}"', scenes[1 + INSTRUCTIONS.index(text)]) for text in wanted]
    return [(label, cell(scene, shown.camera, FRONT_PIXELS)) for label, scene in chosen]


def object_rows(shown: Shown) -> list[list[Labelled]]:
    """The scene before and after OBJECTS, in two rows."""
    chosen = [("before", shown.scene)]
    chosen += [(f'"{text}"', made) for text, made in zip(OBJECTS, edits(shown, OBJECTS))]
    cells = [(label, cell(scene, shown.camera, FRONT_PIXELS)) for label, scene in chosen]
    half = len(cells) // 2
    return [cells[:half], cells[half:]]


def save_pairs(shown: Shown, scenes: Sequence[Gaussians | None], folder: Path) -> None:
    """Write a picture for each instruction: before and after, side by side."""
    folder.mkdir(parents=True, exist_ok=True)
    before = cell(scenes[0], shown.camera, PAIR_PIXELS)
    for i, (text, scene) in enumerate(zip(INSTRUCTIONS, scenes[1:], strict=True)):
        camera = shown.facing(scene) if i == COPIED and scene is not None else shown.camera
        first = before if camera is shown.camera else cell(scenes[0], camera, PAIR_PIXELS)
        pair = [("before", first), (text, cell(scene, camera, PAIR_PIXELS))]
        save(grid([pair]), folder / f"{i + 1:02d}.jpg")


def save(sheet: Image.Image, path: Path) -> None:
    """Write a JPEG of at most 0.9 MB, of the best quality that allows."""
    for quality in range(90, 40, -5):
        sheet.save(path, quality=quality, optimize=True)
        if path.stat().st_size <= 900_000:
            break
    say(str(path))


def say(text: str) -> None:
    sys.stderr.write(text + "\n")  # which Python writes line by line


def main(paths: Sequence[Path], out: Path) -> None:
    """Edit all scenes and write their pictures, the sheet and the front picture."""
    columns, front, moves = [], [], []
    for number, shown in enumerate(map(load_shown, paths)):
        scenes = [shown.scene, *edits(shown, INSTRUCTIONS)]
        save_pairs(shown, scenes, out / f"{number}-{shown.name}")
        if number < len(FRONT):
            front.append(front_row(shown, scenes, FRONT[number]))
            save(grid(front), out / "front.jpg")
            moves.append(moving(shown, scenes[1 + INSTRUCTIONS.index(MOVING[number])]))
        if number == 0:
            save(grid(object_rows(shown)), out / "objects.jpg")
        columns.append([cell(scene, shown.camera, CELL_PIXELS) for scene in scenes])
        rows = zip(("before", *INSTRUCTIONS), *columns)
        cells = [[(label, one), *(("", each) for each in rest)] for label, one, *rest in rows]
        save(grid(cells), out / "sheet.jpg")  # whole after the last scene
    frames = (np.concatenate(row, 1) for row in zip(*(each.frames() for each in moves)))
    gsedit.write_loop(frames, out / "front.webp", FPS, overwrite=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Edits of several scenes, before and after.")
    parser.add_argument("scenes", nargs="+", type=Path, help="scene files, cameras.json beside")
    parser.add_argument("-o", "--output", type=Path, required=True, help="a folder")
    given = parser.parse_args()
    main(given.scenes, given.output)
