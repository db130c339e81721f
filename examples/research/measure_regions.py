"""How well the subject is found, against outlines drawn by hand and exact synthetic masks.

python -m research.measure_regions bear.ply ../shared/data

The outlines are in tests/data/outlines.json: polygons in pixels of 512-pixel pictures, the bear's
drawn on photos, the robot's on renders. `h w` pixels.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from time import process_time
from typing import Annotated, NamedTuple

import numpy as np
import torch
import typer
from jaxtyping import Float
from PIL import Image, ImageDraw
from scipy.ndimage import distance_transform_edt
from torch import Tensor

from gsedit.cameras.around import find_viewpoints
from gsedit.cameras.orbit import circle
from gsedit.datasets.load import load_dataset
from gsedit.datasets.viewpoints import Viewpoint, viewpoints_of
from gsedit.editing.painters import PAINTERS, Looking
from gsedit.editing.plan import key_of
from gsedit.formats.scenes import load
from gsedit.measures.decibels import psnr_from_rmse
from gsedit.measures.metrics import NEAREST, pooled_rmse, squared_error
from gsedit.scene.picture import render_picture
from gsedit.select.finder import Finder
from gsedit.select.region import Region, coverage, in_one_color
from gsedit.words.instruction import Change
from rasterizer.camera import Camera
from rasterizer.render import render
from rasterizer.scene import Gaussians
from research.command import print_result, run
from research.labelled import Labelled, demo_bear, statue

SIZE = 256
"""Longer side of the compared pictures."""
OUTLINES = Path(__file__).parents[2] / "tests" / "data" / "outlines.json"
DRAWN_SIZE = 512
"""Side of the pictures on which outlines were drawn."""
RIM_PIXELS = 3.0
"""Distance from the true outline within which a pixel is of the rim."""
DISTANCES = (2.0, 8.0)
"""Distances from the outline, pixels, beyond which paint is looked for."""
PAINT = Change("subject", "paint", "red", "#e50000", None, "paint")
VIEWS = 16
"""Views of the synthetic scenes."""
COUNT = 12_000
"""Gaussians of the synthetic scenes."""


class Case(NamedTuple):
    """A scene, the views in which its subject is searched, and its true masks."""

    name: str
    scene: Gaussians
    viewpoints: Sequence[Viewpoint]
    truth: Sequence[tuple[Camera, Float[Tensor, "h w"]]]


class Score(NamedTuple):
    """How near a region comes to true masks, means over the pictures."""

    iou: float
    bare: float
    """Share of the rim's inner pixels that are not of the region."""
    spilt: float
    """Share of the rim's outer pixels that are of the region."""
    beyond: tuple[float, ...]
    """PSNR of a painted scene to the unpainted one farther than DISTANCES outside the outline."""
    seconds: float
    """CPU seconds of the search."""


@torch.no_grad()
def measure(case: Case) -> Score:
    """Find the subject and compare it with the masks."""
    start = process_time()
    region = Finder(case.scene, case.viewpoints).subject
    seconds = process_time() - start
    painted = PAINTERS["paint"](
        case.scene, (PAINT,), {key_of(PAINT): region.inside}, Looking()
    ).scene
    rows, errors = [], [[] for _ in DISTANCES]
    for camera, mask in case.truth:
        shown = render(in_one_color(case.scene, region.inside), camera)
        found = shown.color[..., 0].numpy() > 0.5
        true = mask.numpy() > 0.5
        inner, outer = (np.asarray(distance_transform_edt(side)) for side in (true, ~true))
        inner_rim, outer_rim = true & (inner <= RIM_PIXELS), ~true & (outer <= RIM_PIXELS)
        rows.append(
            (
                (found & true).sum() / (found | true).sum(),
                (inner_rim & ~found).sum() / inner_rim.sum(),
                (outer_rim & found).sum() / outer_rim.sum(),
            )
        )
        before, after = (render_picture(scene, camera) for scene in (case.scene, painted))
        for each, distance in zip(errors, DISTANCES):
            each.append(squared_error(after, before, torch.from_numpy(outer > distance)))
    iou, bare, spilt = np.mean(rows, axis=0).tolist()
    beyond = tuple(min(psnr_from_rmse(pooled_rmse(each) or 0), NEAREST) for each in errors)
    return Score(iou, bare, spilt, beyond, seconds)


def drawn(outlines: Sequence[Sequence[float]], size: int) -> Float[Tensor, "{size} {size}"]:
    """The share of each pixel that is inside the polygons, which alternate x and y."""
    picture = Image.new("L", (4 * DRAWN_SIZE, 4 * DRAWN_SIZE))
    for outline in outlines:
        ImageDraw.Draw(picture).polygon([4 * each for each in outline], fill=255)
    small = picture.resize((size, size), Image.Resampling.BOX)
    return torch.from_numpy(np.array(small)).float() / 255


def outlines_of(name: str) -> list[dict]:
    """The views of a scene with outlines."""
    return json.loads(OUTLINES.read_text())[name]


def bear_case(scene: Path, photos: Path) -> Case:
    """The bear, with outlines on photos."""
    viewpoints = viewpoints_of(load_dataset(photos))
    cameras = {each.name: each.camera.fitted(SIZE) for each in viewpoints}
    truth = [(cameras[v["photo"]], drawn(v["outlines"], SIZE)) for v in outlines_of("bear")]
    return Case("bear", load(scene), viewpoints, truth)


def robot_case(file: Path) -> Case:
    """The robot and its ground, with outlines on renders: rough ground, and hands that hover."""
    scene, truth = load(file), []
    for view in outlines_of("playbot"):
        pose = torch.tensor(view["world_to_camera"], dtype=torch.float64)
        focal, middle = view["focal"], DRAWN_SIZE / 2
        camera = Camera(pose, focal, focal, middle, middle, DRAWN_SIZE, DRAWN_SIZE)
        truth.append((camera.fitted(SIZE), drawn(view["outlines"], SIZE)))
    return Case("robot", scene, find_viewpoints(scene, 24, SIZE), truth)


def lone_case(file: Path) -> Case:
    """A scan with nothing around it: all that is seen is the subject."""
    scene = load(file)
    viewpoints = find_viewpoints(scene, 24, SIZE)
    truth = [(v.camera, render(scene, v.camera).alpha.detach()) for v in viewpoints[::6]]
    return Case(file.name.split(".")[0], scene, viewpoints, truth)


def synthetic_case(name: str, labelled: Labelled, distance: float) -> Case:
    """A scene whose masks are exact: the share of each pixel that the subject's Gaussians give."""
    middle = torch.tensor([0.0, 0.0, -0.1], dtype=torch.float64)
    cameras = circle(
        middle, distance, labelled.scene.up, VIEWS, SIZE, elevation=22.0, fov=45.0
    )  # fmt: skip
    viewpoints = [Viewpoint(str(i), camera) for i, camera in enumerate(cameras)]
    true = Region(labelled.subject)
    truth = [(camera, coverage(true, labelled.gaussians, camera)) for camera in cameras[::3]]
    return Case(name, labelled.gaussians, viewpoints, truth)


def cases(bear: Path, data: Path) -> Iterator[Case]:
    """All scenes; those whose files are not there are left out."""
    if bear.exists():
        yield bear_case(bear, data / "bear")
    robot = data / "splats" / "playbot" / "3_0" / "meta.json"
    if robot.exists():
        yield robot_case(robot)
    for name in ("guitar", "biker"):
        file = data / "splats" / f"{name}.compressed.ply"
        if file.exists():
            yield lone_case(file)
    yield synthetic_case("demo", demo_bear(COUNT), 1.0)
    for seed in range(6):
        yield synthetic_case(f"statue {seed}", statue(seed, COUNT), 0.62)


def main(
    bear: Annotated[Path, typer.Argument(help="The bear, fitted from the folder of photos.")],
    data: Annotated[Path, typer.Argument(help="Folder with bear/ and splats/.")],
) -> None:
    """Print a table with a row a scene."""
    print_result(
        "| scene | IoU | rim bare | rim spilt | 2 px outside | 8 px outside | CPU seconds |\n"
        "|---|---|---|---|---|---|---|"
    )
    for case in cases(bear, data):
        score = measure(case)
        print_result(
            f"| {case.name} | {score.iou:.3f} | {score.bare:.1%} | {score.spilt:.1%} "
            f"| {' | '.join(f'{each:.1f} dB' for each in score.beyond)} | {score.seconds:.1f} |"
        )


if __name__ == "__main__":
    run(main)
