"""Ways to draw a scene: the defaults, and one knob at a time turned away from them.

`h w` pixels.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.errors import UsageError
from rasterizer import Camera, Execution, Gaussians, Numerics, render
from rasterizer.numerics import AUTO, DEFAULT
from rasterizer.reference import render_reference

BASELINE = "baseline"
TORCH = replace(AUTO, kernel="torch")


@dataclass(frozen=True)
class Setting:
    """A way to draw: the defaults, but for one knob."""

    knob: str = "default"
    value: str = ""
    numerics: Numerics = DEFAULT
    execution: Execution = AUTO
    dtype: torch.dtype = torch.float32
    degree: int | None = None
    """SH bands above this are left out."""
    resolution: float = 1.0
    """Side of the picture that is drawn and then enlarged (bilinear), as a share of the result."""
    textbook: bool = False
    """The reference's formula in this dtype instead of the rasterizer's."""

    @property
    def dtype_name(self) -> str:
        """Name of the dtype, such as "float32"."""
        return str(self.dtype).removeprefix("torch.")


def _floors() -> list[Setting]:
    return [
        Setting("floor", f"{n:g}/255", numerics=replace(DEFAULT, alpha_min=n / 255))
        for n in (0.5, 2.0, 4.0, 16.0)
    ]


def _stops() -> list[Setting]:
    return [
        Setting("stop", f"{stop:g}", numerics=replace(DEFAULT, transmittance_min=stop))
        for stop in (0.0, 1e-5, 1e-4, 1e-3, 1e-2)
        if stop != DEFAULT.transmittance_min
    ]


def _tiles() -> list[Setting]:
    sizes = (4, 8, 16, 32)
    return [Setting("tile", str(n), execution=replace(AUTO, tile_size=n)) for n in sizes]


def _blocks() -> list[Setting]:
    return [Setting("block", str(n), execution=replace(TORCH, block=n)) for n in (8, 16, 32, 64)]


def _resolutions() -> list[Setting]:
    return [Setting("resolution", f"{r:g}", resolution=r) for r in (0.25, 0.5, 0.71)]


KNOBS: dict[str, Callable[[], list[Setting]]] = {
    "floor": _floors,
    "stop": _stops,
    "tile": _tiles,
    "block": _blocks,
    "cull": lambda: [Setting("cull", "box", execution=replace(AUTO, cull="box"))],
    "kernel": lambda: [Setting("kernel", "torch", execution=TORCH)],
    "dtype": lambda: [Setting("dtype", "float64", dtype=torch.float64)],
    "degree": lambda: [Setting("degree", str(n), degree=n) for n in range(4)],
    "resolution": _resolutions,
    BASELINE: lambda: [Setting(BASELINE, "textbook conic", textbook=True)],
}
"""Values to try, by knob."""


def parse_knobs(text: str) -> tuple[str, ...]:
    """Knobs from names separated by commas. Raises UsageError for an unknown name."""
    names = tuple(dict.fromkeys(part.strip() for part in text.split(",")))
    unknown = [name for name in names if name not in KNOBS]
    if unknown:
        raise UsageError(f"--knobs {text}: no knob {unknown[0]!r}; there are {', '.join(KNOBS)}")
    return names


def settings_of(knobs: Sequence[str], degree: int, *, quick: bool = False) -> list[Setting]:
    """The defaults, then all values of the knobs, for a scene of that SH degree.

    Degrees that the scene does not exceed are left out. `quick`: the first and the last value.
    """
    settings = [Setting()]
    for knob in knobs:
        values = [s for s in KNOBS[knob]() if s.degree is None or s.degree < degree]
        settings += [values[0], values[-1]] if quick and len(values) > 2 else values
    return settings


def draw(setting: Setting, scene: Gaussians, camera: Camera) -> Float[Tensor, "h w 3"]:
    """A picture drawn with a setting; differentiable."""
    if setting.degree is not None:
        scene = replace(scene, sh=scene.sh[:, : (setting.degree + 1) ** 2])
    if setting.textbook:
        return render_reference(scene, camera, dtype=setting.dtype).color
    small = reduced(camera, setting.resolution)
    color = render(scene, small, numerics=setting.numerics, execution=setting.execution).color
    if setting.resolution == 1:
        return color
    enlarged = torch.nn.functional.interpolate(
        color.permute(2, 0, 1)[None], (camera.height, camera.width), mode="bilinear",
        align_corners=False,
    )  # fmt: skip
    return enlarged[0].permute(1, 2, 0)


def reduced(camera: Camera, resolution: float) -> Camera:
    """Resize a view to sides of `resolution` times as many pixels, at least one."""
    if resolution == 1:
        return camera
    width, height = (max(1, round(n * resolution)) for n in (camera.width, camera.height))
    return camera.resized(width, height)
