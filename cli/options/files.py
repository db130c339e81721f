"""Options of the file formats that have any, the same in every verb that reads or writes one."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from ..core.command import option
from ..core.console import print_message

if TYPE_CHECKING:
    from gsedit.formats.streams import ReadOptions, WriteOptions


@dataclass(frozen=True)
class FileOptions:
    """How files are read and written, where the format leaves a choice."""

    spz_frame: Literal["rub", "rdf"] = option(
        "rub", "Axes of an .spz that names none: rub (its specification), or rdf."
    )
    spz_version: int = option(3, "Version of the .spz to write.", min=3, max=4)

    samples: int = option(100000, "Gaussians on the surface of a mesh that is read.", min=1)

    def read(self) -> ReadOptions:
        from gsedit.formats.streams import ReadOptions

        return ReadOptions(spz_frame=self.spz_frame, samples=self.samples)

    def write(self, out: Path) -> WriteOptions:
        """For a scene at `out`: what its format rounds more than usual is printed."""
        from gsedit.formats.streams import WriteOptions

        return WriteOptions(
            spz_version=self.spz_version,
            spz_frame=self.spz_frame,
            say=lambda text: print_message(f"{out}: {text}"),
        )
