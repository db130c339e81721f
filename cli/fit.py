"""`gsedit fit`: a scene from a folder of posed photos."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from .checkpoints import Checkpoints, run_to_result
from .console import print_message, print_result
from .options import Compile, DropInvalid, Force, Seeded, Size, check_scene_file, output, read
from .progress import progress


@dataclass(frozen=True)
class FitOptions:
    """How long and how fine; what is not given is for the library to choose."""

    steps: Annotated[
        int | None,
        typer.Option("--steps", min=1, show_default=False, help="Stop after this many steps."),
    ] = None
    minutes: Annotated[
        float | None,
        typer.Option("--minutes", min=0.01, show_default=False, help="Stop after this long."),
    ] = None

    sh_degree: Annotated[
        int | None,
        typer.Option(
            "--sh-degree", min=0, max=3, show_default=False, help="How colours vary with the view."
        ),
    ] = None

    compile: Compile = False

    def fields(self) -> dict[str, Any]:
        """What was given, as fields of FitSettings."""
        fields: dict[str, Any] = {}
        if self.steps is not None or self.minutes is not None:  # one budget lifts the other
            fields = {"steps": self.steps, "seconds": self.minutes and 60 * self.minutes}
        if self.sh_degree is not None:
            fields["sh_degree"] = self.sh_degree
        if self.compile:
            from rasterizer.numerics import Execution

            fields["execution"] = Execution(compile=True)
        return fields


def fit(
    dataset: Annotated[
        Path,
        typer.Argument(
            metavar="DATASET",
            show_default=False,
            help="Folder of posed photos: nerfstudio (transforms.json) or COLMAP.",
        ),
    ],
    out: Annotated[Path, output("Scene to write: .ply, .compressed.ply or .spz.")],
    size: Size = 256,
    *,
    options: FitOptions,
    start: Annotated[
        Path | None,
        typer.Option(
            "--from", metavar="SCENE", show_default=False, help="Continue from this scene."
        ),
    ] = None,
    drop_invalid: DropInvalid = False,
    force: Force = False,
    common: Seeded,
) -> None:
    """Fit a scene to posed photos. Every 8th photo is held out and measures the result.

    gsedit fit photos/ -o scene.ply --size 256 --minutes 10
    """
    check_scene_file(out, force)
    checkpoints = Checkpoints(
        out.with_suffix(".checkpoint.ply"),
        f"continue with gsedit fit {dataset} -o {out} --from {out.with_suffix('.checkpoint.ply')}",
    )
    refuse_forgotten(checkpoints.path, force=force or start is not None)
    common.apply()

    from gsedit.files import load_dataset, save
    from gsedit.fitting.fit import fit_steps
    from gsedit.fitting.settings import FitSettings

    first = None if start is None else read(start, drop_invalid=drop_invalid)
    photos = load_dataset(dataset, size=size)
    settings = FitSettings(**options.fields())
    with checkpoints:
        with progress(as_json=common.json) as show:
            steps = fit_steps(photos, settings, generator=common.generator(), start=first)
            result = run_to_result(steps, show, checkpoints)
        save(result.scene, out, overwrite=force)
    print_message(
        f"{len(result.scene)} Gaussians, {result.psnr:.2f} dB on held-out photos, "
        f"{result.steps} steps in {result.seconds:.0f} s; look: gsedit preview {out}"
    )
    record = {
        "scene": str(out),
        "gaussians": len(result.scene),
        "psnr": result.psnr,
        "steps": result.steps,
        "seconds": result.seconds,
        "curve": [list(point) for point in result.curve],
    }
    print_result(record, str(out), as_json=common.json)


def refuse_forgotten(checkpoint: Path, *, force: bool) -> None:
    """Raise UsageError rather than write over what an interrupted fit left behind."""
    from gsedit.errors import UsageError

    if checkpoint.exists() and not force:
        raise UsageError(
            f"{checkpoint} is left from an interrupted fit: continue it with --from {checkpoint}, "
            "or add -f to start again"
        )
