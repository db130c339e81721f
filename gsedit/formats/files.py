"""Open and write scene files by their format: which one a path means, and what it cannot hold."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

from gsedit.errors import UsageError
from gsedit.formats.ply.records import read_ply_header
from gsedit.formats.registry import FORMATS, INDEX, READABLE, WRITABLE, Format
from gsedit.formats.streams import (
    AS_SPECIFIED,
    PROGRAM,
    Blocks,
    ReadOptions,
    SceneHeader,
    SceneSource,
)
from gsedit.run.atomic import atomic_path
from gsedit.run.inputs import existing_file


def open_scene(path: str | Path, options: ReadOptions = AS_SPECIFIED) -> SceneSource:
    """Open a scene file by its suffix, a .ply by its content too: read and check its header.

    Raises UsageError for another suffix, InputError for a file that is not what it should be.
    """
    path = Path(path)
    path = path / INDEX if (path / INDEX).is_file() else path
    existing_file(path)  # before the suffix: that the file is missing is the more useful message
    format = _format(path)
    if format is None:
        raise UsageError(f"{path}: gsedit reads {', '.join(READABLE)}: name one of these")
    name = format.module
    if format.suffix.endswith(".ply"):
        name = _ply_kind(path)
    elif name == "gltf.file":
        from gsedit.formats.gltf.file import holds_splats

        name = name if holds_splats(path) else "mesh"
    return import_module(f"gsedit.formats.{name}").open_source(path, options)


def writable_format(path: str | Path) -> Format:
    """The format to write at a path. Raises UsageError where there is none."""
    format = _format(Path(path))
    if format is None or not format.writes:
        raise UsageError(f"{path}: gsedit writes {', '.join(WRITABLE)}: choose one of these")
    return format


def lost(header: SceneHeader, format: Format) -> list[str]:
    """Parts of a scene that a format cannot hold, one sentence each; rounding is not counted."""
    kept, suffix = format.keeps, format.suffix
    comments = [c for c in header.comments if not c.startswith(PROGRAM)]
    sentences = []
    if header.degree > format.max_degree:
        bands = f"SH above degree {format.max_degree}" if format.max_degree else "SH"
        sentences.append(f"{suffix} holds no {bands}: of degree {header.degree} left out")
    if header.extra and "extra" not in kept:
        sentences.append(f"{suffix} holds no extra columns: {', '.join(header.extra)} left out")
    if header.elements and "elements" not in kept:
        sentences.append(f"{suffix} holds no other elements: {', '.join(header.elements)} left out")
    if comments and "comments" not in kept:
        sentences.append(f"{suffix} holds no comments: {'; '.join(comments)} left out")
    if header.antialiased and "antialiased" not in kept and "comments" not in kept:
        sentences.append(f"{suffix} cannot say that a scene is antialiased: left out")
    return sentences


def write_scene(
    path: str | Path, header: SceneHeader, blocks: Blocks, *, overwrite: bool = False
) -> int:
    """Write rows by the suffix of `path`: whole or not at all. Returns their number.

    Creates parent folders. Raises UsageError if the file exists (and not `overwrite`), the suffix
    is unknown, the SH degree does not fit, or there are no rows.
    """
    path, format = Path(path), writable_format(path)
    if header.degree > format.max_degree:
        raise UsageError(
            f"{path}: {format.suffix} holds SH up to degree {format.max_degree}, the scene has "
            f"{header.degree}: reduce its SH degree first"
        )
    blocks = (block for block in blocks if len(block))  # a filter may leave nothing of a part
    with atomic_path(path, overwrite=overwrite) as temporary:
        module = import_module(f"gsedit.formats.{format.module}")
        try:
            count = module.write(temporary, header, blocks)
        except UsageError as error:  # a writer knows the temporary name only
            raise UsageError(str(error).replace(str(temporary), str(path))) from None
        if not count:
            raise UsageError(
                f"{path} would hold no Gaussians: nothing was written, keep at least one"
            )
    return count


def _format(path: Path) -> Format | None:
    """The one with the longest suffix that the name ends in."""
    fitting = [format for format in FORMATS if path.name.lower().endswith(format.suffix)]
    return max(fitting, key=lambda format: len(format.suffix), default=None)


def _ply_kind(path: Path) -> str:
    """The module that reads this .ply: exporters often leave ".compressed" out of the name, and
    meshes and point clouds have the same suffix."""
    from gsedit.formats.ply.compressed import is_compressed
    from gsedit.formats.ply.inria import is_splats

    header = read_ply_header(path)
    vertex = header.element("vertex")
    names = vertex.names if vertex else ()
    if is_compressed(header):
        return "ply.compressed"
    return "mesh" if {"x", "y", "z"} <= {*names} and not is_splats(names) else "ply.inria"
