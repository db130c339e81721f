"""Options that most verbs share, the scenes that they name, and numbers in the text of options."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from gsedit.errors import UsageError
from rasterizer.numerics import DEFAULT, Numerics

from ..core.command import argument, option
from ..core.console import print_message
from ..core.current import current_scene

if TYPE_CHECKING:
    from gsedit.formats.scenes import SceneFile
    from gsedit.formats.streams import ReadOptions
    from gsedit.measures.features import FeatureExtractor
    from rasterizer.scene import Gaussians


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


@dataclass(frozen=True)
class Reads:
    """Option of every verb that reads a scene."""

    drop_invalid: bool = option(False)
    """Skip Gaussians with NaN or Inf instead of refusing the file."""


@dataclass(frozen=True)
class Writes:
    """Option of every verb that writes a file."""

    force: bool = option(False, flags="--force -f")
    """Replace files that exist at the output."""


@dataclass(frozen=True)
class Resumes(Writes):
    """Options of a verb whose long work can be continued."""

    resume: bool = option(False)
    """Continue an interrupted run of this command from its last checkpoint; begin where there is
    none."""


@dataclass(frozen=True)
class Folder(Writes):
    """Output of a verb that writes a folder."""

    out: Path = option(..., "PATH", flags="--output -o")
    """Folder for the results."""


@dataclass(frozen=True)
class Data:
    """Option of every verb that looks through the cameras of photos."""

    data: Path | None = option(None, "DATASET")
    """Folder of posed photos: nerfstudio (transforms.json) or COLMAP."""


@dataclass(frozen=True)
class FileOptions:
    """How files are read that do not say it themselves."""

    spz_frame: Literal["rub", "rdf"] = option("rub")
    """Axes of an .spz that names none: rub (its specification), or rdf."""
    samples: int = option(100000, min=1)
    """Gaussians on the surface of a mesh that is read."""

    def read(self) -> ReadOptions:
        from gsedit.formats.streams import ReadOptions

        return ReadOptions(spz_frame=self.spz_frame, samples=self.samples)


def numbers(flag: str, text: str, *counts: int) -> list[float]:
    """Read finite numbers separated by commas, one of `counts` of them. Raises UsageError."""
    try:
        found = [float(part) for part in text.split(",")]
    except ValueError:
        found = []
    if len(found) not in counts or not all(map(isfinite, found)):
        one = counts == (1,)
        many = "a finite number" if one else f"{' or '.join(map(str, counts))} finite numbers"
        raise UsageError(f"{flag} {text}: give {many}{'' if one else ' separated by commas'}")
    return found


def numerics_of(file: SceneFile | None, name: Path | None) -> Numerics:
    """How a scene is rendered that was read from a file; a line says so where it is unusual."""
    if file is None or not file.header.antialiased:
        return DEFAULT
    print_message(f"{name} is marked as antialiased: it is rendered with Mip-Splatting's 2D filter")
    return file.numerics


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


def load_features(name: str) -> FeatureExtractor:
    """Load the features under the Gram loss. Raises UsageError for another name."""
    if name == "filters":
        from gsedit.measures.features import FilterBank

        return FilterBank()
    if name == "vgg":
        from gsedit.measures.perceptual import vgg_features

        return vgg_features()
    raise UsageError(f"--features must be filters or vgg, not {name!r}")
