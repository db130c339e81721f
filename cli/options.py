"""Options that several verbs share, and the checks that verbs make before any work begins."""

from __future__ import annotations

import os
from collections.abc import Collection
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .console import print_message
from .ranks import is_first

if TYPE_CHECKING:
    import torch

    from gsedit.files import SceneFile
    from rasterizer.numerics import Numerics
    from rasterizer.scene import Gaussians


current_scene: ContextVar[Path | None] = ContextVar("current_scene", default=None)
"""SCENE of the command that runs, for options that need the cameras beside it; None once an
operation has moved the scene away from them."""


def first_scene(path: Path) -> Path:
    """`scene_file` of SCENE, which is the current one from now on."""
    path = scene_file(path)
    current_scene.set(path)
    return path


def scene_file(path: Path) -> Path:
    """The scene of the folder of an edit; any other path as it is."""
    from gsedit.errors import UsageError

    if (path / "scene.ply").is_file():
        return path / "scene.ply"
    if (path / "checkpoint.safetensors").is_file():
        raise UsageError(
            f"{path} holds an edit that was interrupted: end it with --resume, or make a scene of "
            f"its checkpoint with gsedit recover {path} -o SCENE.ply"
        )
    return path


Scene = Annotated[
    Path,
    typer.Argument(
        metavar="SCENE",
        help="A Gaussian splat scene (.ply), or the folder of an edit.",
        show_default=False,
        callback=first_scene,
    ),
]
Data = Annotated[
    Path | None,
    typer.Option(
        "--data",
        metavar="DATASET",
        show_default=False,
        help="Folder of posed photos: nerfstudio (transforms.json) or COLMAP.",
    ),
]
Size = Annotated[
    int,
    typer.Option("--size", min=16, metavar="PIXELS", help="Longer side of the views."),
]
DropInvalid = Annotated[
    bool,
    typer.Option(
        "--drop-invalid", help="Leave out Gaussians with NaN or Inf instead of refusing the file."
    ),
]
Force = Annotated[
    bool, typer.Option("--force", "-f", help="Replace files that exist at the output.")
]


def output(what: str) -> Any:
    """The -o option of a verb that writes `what`."""
    return typer.Option("--output", "-o", metavar="PATH", show_default=False, help=what)


def common_option(name: str, help: str, **more: Any) -> Any:
    """An option that every command has."""
    return typer.Option(name, help=help, rich_help_panel="Every command", **more)


@dataclass(frozen=True)
class Common:
    """Options of every verb."""

    json: Annotated[
        bool, common_option("--json", "Print results and events as JSON lines on stdout.")
    ] = False
    debug: Annotated[bool, common_option("--debug", "Show the traceback of an error.")] = False
    threads: Annotated[
        int | None,
        common_option("--threads", "CPU threads to use.", min=1, show_default="torch's choice"),
    ] = None

    def apply(self) -> None:
        """Set torch's number of threads."""
        if self.threads:
            import torch

            torch.set_num_threads(self.threads)


@dataclass(frozen=True)
class Seeded(Common):
    """Options of every verb that draws random numbers."""

    seed: Annotated[
        int,
        common_option(
            "--seed", "Seed of the random numbers. Equal seeds and threads give equal results."
        ),
    ] = 0

    def generator(self) -> torch.Generator:
        """The only source of random numbers of a command."""
        import torch

        return torch.Generator().manual_seed(self.seed)


def check_file(path: Path, force: bool) -> None:
    """Raise UsageError unless a file can be written at `path`: checked before the work, by the
    rank that writes."""
    if not is_first():
        return
    from gsedit.files.atomic import check_writable

    check_writable(path, overwrite=force)
    _check_permission(path.parent)


def check_scene_file(path: Path, force: bool) -> None:
    """Raise UsageError unless a scene can be written at `path`."""
    from gsedit.errors import UsageError
    from gsedit.files.scenes import WRITABLE

    if not path.name.lower().endswith(WRITABLE):
        raise UsageError(f"-o {path}: name a scene file: {', '.join(WRITABLE)}")
    check_file(path, force)


def check_folder(path: Path, force: bool, *, leftovers: Collection[str] = ()) -> None:
    """Raise UsageError unless `path` can be a folder of results: new or empty, or -f was given.
    The rank that writes looks.

    Files of the names `leftovers` are nothing to keep, nor are those whose writing was interrupted.
    """
    from gsedit.errors import UsageError
    from gsedit.files.atomic import is_temporary

    if not is_first():
        return
    if path.exists() and not path.is_dir():
        raise UsageError(f"-o {path} is a file: name a folder")
    _check_permission(path)
    names = {each.name for each in path.iterdir()} if path.is_dir() else set()
    if not force and any(name not in leftovers and not is_temporary(name) for name in names):
        raise UsageError(
            f"-o {path} has files in it already: add -f to replace them, or choose another folder"
        )


def _check_permission(folder: Path) -> None:
    from gsedit.errors import UsageError

    nearest = next(p for p in (folder, *folder.absolute().parents) if p.exists())
    if not nearest.is_dir():
        raise UsageError(f"-o: {nearest} is a file, so nothing can be written below it")
    if not os.access(nearest, os.W_OK | os.X_OK):
        raise UsageError(f"-o: no permission to write in {nearest}; choose another place")


def numerics_of(file: SceneFile | None, name: Path | None) -> Numerics:
    """How a scene is rendered that was read from a file; a line says so where it is unusual."""
    from rasterizer.numerics import DEFAULT, Numerics

    if file is None or not file.header.antialiased:
        return DEFAULT
    print_message(f"{name} is marked as antialiased: it is rendered with Mip-Splatting's 2D filter")
    return Numerics(antialiased=True)


def load_scene(path: Path, *, drop_invalid: bool) -> Gaussians:
    """The scene at `path`; notes on the file are printed, a line each."""
    return load_file(path, drop_invalid=drop_invalid).scene


def load_file(path: Path, *, drop_invalid: bool) -> SceneFile:
    """`load_scene`, with the columns of the file that are no part of a Gaussian."""
    from gsedit.files import read_scene

    file = read_scene(path, drop_invalid=drop_invalid)
    for note in file.notes:
        print_message(f"{path}: {note}")
    return file


def parse_indices(text: str, option: str) -> list[int]:
    """Whole numbers separated by commas, as in `--views 0,8,16`; UsageError otherwise."""
    from gsedit.errors import UsageError

    try:
        return [int(part) for part in text.split(",")]
    except ValueError:
        raise UsageError(
            f"{option} {text}: give numbers separated by commas, as in 0,8,16"
        ) from None
