"""Options of the file formats that have any, the same in every verb that reads or writes one."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .console import print_message

if TYPE_CHECKING:
    from gsedit.files.streams import ReadOptions, WriteOptions


class SpzFrame(str, Enum):
    """Axes of an .spz."""

    rub = "rub"
    rdf = "rdf"


def format_option(name: str, help: str, **more: Any) -> Any:
    """An option of a file format."""
    return typer.Option(name, help=help, rich_help_panel="File formats", **more)


@dataclass(frozen=True)
class FileOptions:
    """How files are read and written, where the format leaves a choice."""

    spz_frame: Annotated[
        SpzFrame,
        format_option(
            "--spz-frame", "Axes of an .spz that names none: rub (its specification), or rdf."
        ),
    ] = SpzFrame.rub
    spz_version: Annotated[
        int, format_option("--spz-version", "Version of the .spz to write.", min=3, max=4)
    ] = 3

    samples: Annotated[
        int, format_option("--samples", "Gaussians on the surface of a mesh that is read.", min=1)
    ] = 100_000

    def read(self) -> ReadOptions:
        from gsedit.files.streams import ReadOptions

        return ReadOptions(spz_frame=self.spz_frame.value, samples=self.samples)

    def write(self, out: Path) -> WriteOptions:
        """For a scene at `out`: what its format rounds more than usual is printed."""
        from gsedit.files.streams import WriteOptions

        return WriteOptions(
            spz_version=self.spz_version,
            spz_frame=self.spz_frame.value,
            say=lambda text: print_message(f"{out}: {text}"),
        )
