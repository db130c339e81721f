"""Options that several verbs share, each named once, and the checks made before any work begins."""

from __future__ import annotations

import os
from dataclasses import dataclass, fields
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .console import print_message

if TYPE_CHECKING:
    import torch

    from rasterizer.scene import Gaussians

Scene = Annotated[
    Path, typer.Argument(metavar="SCENE", help="A Gaussian splat scene (.ply).", show_default=False)
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
    typer.Option("--size", min=16, metavar="PIXELS", help="Longer side of the pictures worked on."),
]
Compile = Annotated[
    bool,
    typer.Option(
        "--compile",
        show_default=False,
        help="Draw with a compiled kernel: the same, sooner; needs a C++ compiler, the first time.",
    ),
]
DropInvalid = Annotated[
    bool,
    typer.Option(
        "--drop-invalid", help="Leave out Gaussians with NaN or Inf instead of refusing the file."
    ),
]
Force = Annotated[
    bool, typer.Option("--force", "-f", help="Overwrite what stands at the output already.")
]


def output(what: str) -> Any:
    """The -o option of a verb that writes `what`."""
    return typer.Option("--output", "-o", metavar="PATH", show_default=False, help=what)


def everywhere(name: str, help: str, **more: Any) -> Any:
    """An option of every command."""
    return typer.Option(name, help=help, rich_help_panel="Every command", **more)


@dataclass(frozen=True)
class Common:
    """What every verb understands."""

    json: Annotated[bool, everywhere("--json", "Results and events as JSON lines on stdout.")] = (
        False
    )
    debug: Annotated[bool, everywhere("--debug", "Show the traceback of an error.")] = False
    threads: Annotated[
        int | None,
        everywhere("--threads", "CPU threads to use.", min=1, show_default="as torch finds"),
    ] = None

    def apply(self) -> None:
        """Give torch the threads that were asked for."""
        if self.threads:
            import torch

            torch.set_num_threads(self.threads)


@dataclass(frozen=True)
class Seeded(Common):
    """What a verb that draws random numbers understands too."""

    seed: Annotated[int, everywhere("--seed", "Same seed, same threads: same result.")] = 0

    def generator(self) -> torch.Generator:
        """The one source of randomness of a command."""
        import torch

        return torch.Generator().manual_seed(self.seed)


def given(options: Any) -> dict[str, Any]:
    """The fields of a group of options that the user set: the rest is for the library to choose."""
    values = {field.name: getattr(options, field.name) for field in fields(options)}
    return {
        name: value.value if isinstance(value, Enum) else value
        for name, value in values.items()
        if value is not None
    }


def check_file(path: Path, force: bool) -> None:
    """Raise UsageError unless a file can be written at `path`: asked before the work, not after."""
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


def check_folder(path: Path, force: bool) -> None:
    """Raise UsageError unless `path` can be a folder of results: new or empty, or -f was given."""
    from gsedit.errors import UsageError

    if path.exists() and not path.is_dir():
        raise UsageError(f"-o {path} is a file: name a folder")
    _check_permission(path)
    if path.is_dir() and any(path.iterdir()) and not force:
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


def read(path: Path, *, drop_invalid: bool) -> Gaussians:
    """The scene at `path`; what the file held besides is said in a line each."""
    from gsedit.files import read_scene

    found = read_scene(path, drop_invalid=drop_invalid)
    for note in found.notes:
        print_message(f"{path}: {note}")
    return found.scene


def whole_numbers(text: str, option: str) -> list[int]:
    """Numbers separated by commas, as in `--views 0,8,16`; UsageError otherwise."""
    from gsedit.errors import UsageError

    try:
        return [int(part) for part in text.split(",")]
    except ValueError:
        raise UsageError(
            f"{option} {text}: give numbers separated by commas, as in 0,8,16"
        ) from None
