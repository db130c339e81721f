"""`gsedit info`: what a scene file holds."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from .console import print_result
from .options import Common, DropInvalid, Scene, load_scene

if TYPE_CHECKING:
    from gsedit.reports.scene_summary import SceneSummary


def info(scene: Scene, drop_invalid: DropInvalid = False, *, common: Common) -> None:
    """Show what a scene file holds: number of Gaussians, SH degree, bounds, opacities and sizes.

    gsedit info scene.ply --json
    """
    common.apply()
    from gsedit.reports.scene_summary import summarise

    size = scene.stat().st_size if scene.is_file() else 0
    summary = summarise(load_scene(scene, drop_invalid=drop_invalid))
    record = {"file": scene, "bytes": size, **asdict(summary)}
    print_result(record, as_text(scene, size, summary), as_json=common.json)


def as_text(path: Path, size: int, summary: SceneSummary) -> str:
    """The summary as an aligned table; `size` is in bytes."""
    ends = {0.0: "min", 1.0: "max"}
    head = "".join(f"{ends.get(q, f'{q:.0%}'):>12}" for q in summary.quantiles)
    rows = [
        f"{name:<12}" + "".join(f"{value:>12.4g}" for value in getattr(summary, name))
        for name in ("x", "y", "z", "opacity", "scale")
    ]
    return "\n".join(
        (
            f"{'file':<12}{path} ({size / 1e6:.2f} MB)",
            f"{'Gaussians':<12}{summary.gaussians}",
            f"{'SH degree':<12}{summary.sh_degree}",
            f"{'':<12}{head}",
            *rows,
        )
    )
