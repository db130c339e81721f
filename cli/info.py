"""`gsedit info`: what a scene file holds."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from .console import print_result
from .options import Common, DropInvalid, Scene, read

if TYPE_CHECKING:
    from torch import Tensor

    from rasterizer.scene import Gaussians

QUANTILES = (0.0, 0.01, 0.5, 0.99, 1.0)


def info(scene: Scene, drop_invalid: DropInvalid = False, *, common: Common) -> None:
    """Count, SH degree, bounds, and how opacities and sizes are spread.

    gsedit info scene.ply --json
    """
    common.apply()
    size = scene.stat().st_size if scene.is_file() else 0
    found = read(scene, drop_invalid=drop_invalid)
    record = {"file": str(scene), "bytes": size, **describe(found)}
    print_result(record, as_text(record), as_json=common.json)


def describe(scene: Gaussians) -> dict[str, Any]:
    """Everything that is told about a scene; spreads are at QUANTILES, in world units."""
    x, y, z = (spread(axis) for axis in scene.means.T)
    return {
        "gaussians": len(scene),
        "sh_degree": scene.degree,
        "quantiles": list(QUANTILES),
        "x": x,
        "y": y,
        "z": z,
        "opacity": spread(scene.opacities),
        "scale": spread(scene.scales.flatten()),
    }


def spread(values: Tensor) -> list[float]:
    """The values at QUANTILES, nearest rank (torch.quantile refuses more than 2^24 values)."""
    ordered = values.double().sort().values
    return [float(ordered[round(q * (len(ordered) - 1))]) for q in QUANTILES]


def as_text(record: dict[str, Any]) -> str:
    """The record as an aligned table."""
    head = "".join(f"{'min' if q == 0 else 'max' if q == 1 else f'{q:.0%}':>12}" for q in QUANTILES)
    rows = [
        f"{name:<12}" + "".join(f"{value:>12.4g}" for value in record[name])
        for name in ("x", "y", "z", "opacity", "scale")
    ]
    return "\n".join(
        (
            f"{'file':<12}{record['file']} ({record['bytes'] / 1e6:.2f} MB)",
            f"{'Gaussians':<12}{record['gaussians']}",
            f"{'SH degree':<12}{record['sh_degree']}",
            f"{'':<12}{head}",
            *rows,
        )
    )
