"""Exact light that moves, on synthetic scenes: relit Gaussians against the truth.

python -m research.moved_light            # the table of docs/measurements/light.md
python -m research.moved_light room       # night in a room, at a view that no camera covers

Pictures are renders of the same Gaussians with the exact color of each under the other light, so
that only light is compared, and only where they are.
"""

from __future__ import annotations

import sys
from collections.abc import Callable

import torch
from torch import Tensor

from gsedit.cameras.place import place_of
from gsedit.editing.routes.apply import seen_weights
from gsedit.light.named import LIGHTS
from gsedit.light.relight import relit
from gsedit.light.setup import LightSetup, Sun
from gsedit.scene.color_space import LUMINANCE
from gsedit.synthetic.daylight import GAMMA, Daylight
from gsedit.synthetic.gallery import columns, demo_scene
from gsedit.synthetic.scene import SyntheticScene
from gsedit.synthetic.splats import ring_cameras, surface_gaussians
from rasterizer import Camera, Gaussians, render
from rasterizer.camera import look_at
from research.noisy_room import room

COUNT, SIZE = 12_000, 192
STARTS = {
    "overcast": Daylight((0.0, 0.0, 1.0), (0.0, 0.0, 0.0), (1.0, 1.0, 1.0), (0.3, 0.3, 0.3)),
    "sun from the right": Daylight((0.6, -0.5, 0.7), (0.6, 0.58, 0.55), (0.6, 0.61, 0.62)),
}
DIM, NIGHT = (0.25, 0.28, 0.35), (0.03, 0.05, 0.1)
ENDS = {
    "sun from the left": LightSetup(DIM, DIM, Sun(-70.0, 30.0, 1.1, (1.0, 0.8, 0.6))),
    "sun from the right, high": LightSetup(DIM, DIM, Sun(80.0, 45.0, 1.1, (1.0, 0.95, 0.9))),
    "overcast": LightSetup((1.0, 1.0, 1.0), (0.3, 0.3, 0.3)),
    "moon from behind": LightSetup(NIGHT, NIGHT, Sun(-110.0, 45.0, 0.2, (0.6, 0.8, 1.0))),
}


def colored(scene: SyntheticScene) -> Gaussians:
    """Gaussians with the exact colors of a scene, at the same places each time."""
    return surface_gaussians(scene, COUNT, torch.Generator().manual_seed(0))


def exact(
    make: Callable[[Daylight], SyntheticScene], setup: LightSetup, front: Tensor
) -> Gaussians:
    """The truth of a setup; `front` is where the cameras are, level."""
    up = torch.tensor((0.0, 0.0, 1.0), dtype=torch.float64)
    place = place_of(colored(make(STARTS["overcast"])), (), None)
    toward, light = (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)
    if setup.sun is not None:
        place = type(place)(place.center, up, front, 1.0, 1.0)
        x, y, z = place.direction(setup.sun.azimuth, setup.sun.elevation).tolist()
        toward = (x, y, z)
        red, green, blue = (setup.sun.strength * c for c in setup.sun.color)
        light = (red, green, blue)
    return colored(make(Daylight(toward, light, setup.sky, setup.ground)))


def say(line: str) -> None:
    """Write a line of the table."""
    sys.stdout.write(f"{line}\n")


def psnr(first: Tensor, second: Tensor) -> float:
    """PSNR of display colors, at most 99 dB."""
    error = (first.clamp(0, 1) - second.clamp(0, 1)).square().mean().clamp_min(1e-10)
    return float(-10 * error.log10())


def compared(before: Gaussians, after: Gaussians, truth: Gaussians, cameras) -> list[float]:
    """PSNR to the truth of the unedited scene, of its best gain of each channel, of the relit
    scene, and of its best gain: exposure is a choice."""
    sums = torch.zeros(4)
    for camera in cameras:
        pictures = [render(each, camera) for each in (before, after, truth)]
        solid = pictures[0].alpha > 0.5
        old, new, exact = (each.color[solid] for each in pictures)
        shown = [
            each
            for found in (old, new)
            for each in (found, (found * exact).sum(0) / found.square().sum(0) * found)
        ]
        sums += torch.tensor([psnr(each, exact) for each in shown])
    return (sums / len(cameras)).tolist()


def table() -> None:
    """Print a row for each scene, present light and asked light."""
    say("| scene | present light | asked light | unedited | its gain | relit | its gain |")
    say("|---|---|---|---|---|---|---|")
    for name, make in {"bear": demo_scene, "columns": columns}.items():
        ring = ring_cameras(make(), 16, SIZE)
        unused = ring_cameras(make(), 3, SIZE, elevation=32, start=-60)
        front = -ring[0].forward * torch.tensor((1.0, 1.0, 0.0), dtype=torch.float64)
        truths = {end: exact(make, setup, front / front.norm()) for end, setup in ENDS.items()}
        for start, light in STARTS.items():
            before = colored(make(light))
            seen = seen_weights(before, ring)
            for end, setup in ENDS.items():
                if start == end:
                    continue
                after = relit(before, setup, ring, seen)
                row = compared(before, after, truths[end], unused)
                say(f"| {name} | {start} | {end} | {' | '.join(f'{x:.1f}' for x in row)} |")


def night_in_a_room() -> None:
    """Print what night does to a wall behind the cameras, against night as one tone of it."""
    draw = torch.Generator().manual_seed(1)
    scene = colored(room(draw))
    up = torch.tensor((0.0, 0.0, 1.0), dtype=torch.float64)

    def camera(x: float, y: float, ahead: float) -> Camera:
        eye = torch.tensor((x, y, 0.3), dtype=torch.float64)
        return look_at(eye, eye + torch.tensor((ahead, 0.1, -0.1)).double(), up, 70.0, SIZE, SIZE)

    cameras = [camera(-0.9, y, 1.0) for y in (-0.5, -0.3, 0.0, 0.3, 0.5)]
    behind = camera(0.2, 0.2, -1.0)
    seen = seen_weights(scene, cameras)
    setup = LIGHTS["night"]
    after = relit(scene, setup, cameras, seen)
    old, new = (render(each, behind).color.clamp(0, 1) for each in (scene, after))
    gray = (old.double() @ torch.from_numpy(LUMINANCE / LUMINANCE.sum()))[..., None]
    muted = gray + setup.saturation * (old - gray)
    gain = (muted * new).sum((0, 1)) / muted.square().sum((0, 1))
    seen_old, seen_new = (
        torch.stack([render(each, one).color for one in cameras]) for each in (scene, after)
    )
    left = [
        float((late.mean() / early.mean()) ** GAMMA)
        for early, late in ((old, new), (seen_old, seen_new))
    ]
    say(f"to night as one tone of that view's picture: {psnr(new, gain * muted):.1f} dB")
    say(f"linear light left: {left[0]:.3f} behind the cameras, {left[1]:.3f} before them")


if __name__ == "__main__":
    night_in_a_room() if "room" in sys.argv[1:] else table()
