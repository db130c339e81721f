"""Options that most verbs share, and the scenes that they name."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from gsedit.errors import UsageError
from rasterizer.numerics import DEFAULT, Numerics

from ..core.command import argument, flag, option
from ..core.console import print_message
from ..core.current import current_scene

if TYPE_CHECKING:
    import torch

    from gsedit.formats.scenes import SceneFile
    from rasterizer.scene import Gaussians


MOST_THREADS = 1024
"""Most threads that may be asked for: each takes memory, and no machine has more cores."""
LARGEST_SEED = (1 << 32) - 1
"""Largest --seed: torch and numpy take it."""


def first_scene(path: Path) -> Path:
    """`scene_file` of SCENE, which is the current one from now on."""
    path = scene_file(path)
    current_scene.set(path)
    return path


def scene_file(path: Path) -> Path:
    """The scene of the folder of an edit; any other path as it is."""
    if (path / "scene.ply").is_file():
        return path / "scene.ply"
    if (path / "checkpoint.safetensors").is_file():
        raise UsageError(
            f"{path} holds an interrupted edit: continue it with --resume, or write its last "
            f"checkpoint as a scene with gsedit convert {path} SCENE.ply"
        )
    return path


Scene = Annotated[
    Path,
    argument(
        "SCENE", "A Gaussian splat scene (.ply), or the folder of an edit.", callback=first_scene
    ),
]
Data = Annotated[
    Path | None,
    flag("--data", "Folder of posed photos: nerfstudio (transforms.json) or COLMAP.", "DATASET"),
]
Size = Annotated[
    int | None,
    flag("--size", "Longer side of the views.", "PIXELS", min=16, show_default="256"),
]
DropInvalid = Annotated[
    bool, flag("--drop-invalid", "Skip Gaussians with NaN or Inf instead of refusing the file.")
]
Force = Annotated[bool, flag("--force -f", "Replace files that exist at the output.")]


@dataclass(frozen=True)
class Common:
    """Options of every verb."""

    json: bool = option(False, "Print results and events as JSON lines on stdout.")
    debug: bool = option(False, "Show the traceback of an error.")
    threads: int | None = option(
        None, "CPU threads to use.", min=1, max=MOST_THREADS, show_default="torch's choice"
    )

    def apply(self) -> None:
        """Set the number of threads, of torch and of programs that are started, for good."""
        if self.threads:
            import torch

            os.environ["OMP_NUM_THREADS"] = str(self.threads)
            torch.set_num_threads(self.threads)


@dataclass(frozen=True)
class Seeded(Common):
    """Options of every verb that draws random numbers."""

    seed: int = option(
        0,
        "Seed of the random numbers. Equal seeds and threads give equal results.",
        min=0,
        max=LARGEST_SEED,
    )

    def generator(self) -> torch.Generator:
        """The only source of random numbers of a command."""
        import torch

        return torch.Generator().manual_seed(self.seed)


def numerics_of(file: SceneFile | None, name: Path | None) -> Numerics:
    """How a scene is rendered that was read from a file; a line says so where it is unusual."""
    if file is None or not file.header.antialiased:
        return DEFAULT
    print_message(f"{name} is marked as antialiased: it is rendered with Mip-Splatting's 2D filter")
    return Numerics(antialiased=True)


def load_scene(path: Path, *, drop_invalid: bool) -> Gaussians:
    """The scene at `path`; notes on the file are printed, a line each."""
    return load_file(path, drop_invalid=drop_invalid).scene


def load_file(path: Path, *, drop_invalid: bool) -> SceneFile:
    """`load_scene`, with the columns of the file that are no part of a Gaussian."""
    from gsedit.formats.scenes import read_scene

    file = read_scene(path, drop_invalid=drop_invalid)
    for note in file.notes:
        print_message(f"{path}: {note}")
    return file
