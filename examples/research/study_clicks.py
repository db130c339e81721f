"""IoU of things selected by clicks, on staged scenes: `python -m research.study_clicks`.

The first click is in the middle of what the view that shows most of a thing shows of it. Each
further one is in the middle of the widest error of all views: inside what is missed, or not: on
what is too much. Two minutes.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from bench.staged import stages
from jaxtyping import Bool
from scipy.ndimage import distance_transform_edt
from torch import Tensor

from gsedit.objects import Click, Selector
from gsedit.select.region import in_one_color
from rasterizer import render
from rasterizer.camera import Camera
from rasterizer.scene import Gaussians
from research.command import print_result, run

SIZE, COUNT, CLICKS = 256, 8000, 3
SETTING = ("floor", "grass", "paving", "wall")
"""Words in the names of what is no object."""


def shares(
    scene: Gaussians, inside: Bool[Tensor, " n"], cameras: Sequence[Camera]
) -> list[np.ndarray]:
    """The share of each pixel that the Gaussians inside give, in each view."""
    colored = in_one_color(scene, inside)
    return [render(colored, camera).color[..., 0].numpy() for camera in cameras]


def widest(masks: Sequence[np.ndarray]) -> tuple[float, int, float, float]:
    """(distance from the border, view, x, y) of the pixel that is deepest in any mask."""
    best = (0.0, 0, 0.0, 0.0)
    for view, mask in enumerate(masks):
        depth = np.asarray(distance_transform_edt(np.pad(mask, 1)))[1:-1, 1:-1]
        y, x = np.unravel_index(int(depth.argmax()), depth.shape)
        best = max(best, (float(depth[y, x]), view, x + 0.5, y + 0.5))
    return best


def ious(selector: Selector, true: Bool[Tensor, " n"], cameras: Sequence[Camera]) -> list[float]:
    """IoU after each of up to CLICKS clicks."""
    exact = shares(selector.scene, true, cameras)
    first = max(range(len(cameras)), key=lambda i: float((exact[i] > 0.5).sum()))
    _, _, x, y = widest([exact[first] > 0.6])
    clicks, found = [Click(cameras[first], x, y)], []
    for _ in range(CLICKS):
        inside = selector.at(clicks).inside
        found.append(float((inside & true).sum() / (inside | true).sum()))
        now = shares(selector.scene, inside, cameras)
        missed = widest([(e > 0.6) & (n < 0.4) for e, n in zip(exact, now)])
        wrong = widest([(e < 0.4) & (n > 0.6) for e, n in zip(exact, now)])
        depth, view, x, y = max(missed, wrong)
        if not depth:
            break
        clicks.append(Click(cameras[view], x, y, inside=missed >= wrong))
    return found


def main() -> None:
    """Print a row a thing: IoU after one click, and after the last."""
    print_result("| stage | thing | one click | three |")
    for stage in stages():
        made, cameras = stage.gaussians(COUNT), stage.training(SIZE)
        selector = Selector(made.scene, cameras)
        for name in made.names:
            if not any(word in name for word in SETTING):
                found = ious(selector, made.of(name), cameras)
                print_result(f"| {stage.name} | {name} | {found[0]:.3f} | {found[-1]:.3f} |")


if __name__ == "__main__":
    run(main)
