"""What `gsedit render` writes: a folder of views, one picture, or an animation."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from .console import print_message, print_result
from .options import Common
from .progress import Show, progress
from .render_options import CRF, PictureOptions, kind_of

if TYPE_CHECKING:
    from gsedit.reports.frames import Animation

Item = TypeVar("Item")


def write(
    animation: Animation,
    names: Sequence[str],
    out: Path,
    fps: float,
    pictures: PictureOptions,
    force: bool,
    common: Common,
) -> None:
    """Write an animation, one picture, or a folder, as the suffix of `out` says; print what was
    written."""
    from gsedit.files.animations import write_gif, write_mp4

    count, as_json = len(animation), common.json
    with progress(as_json=as_json) as show:
        if kind_of(out) == "folder":
            for index in tracked(range(count), count, show):
                stem = out / names[index]
                for path in write_files(animation, index, stem, pictures, force):
                    print_result({"picture": path}, str(path), as_json=as_json)
            print_message(f"{count} views are in {out}")
        elif kind_of(out) == "still":
            write_one(animation, out, pictures, force)
            print_result({"picture": out}, str(out), as_json=as_json)
        else:
            frames = tracked(animation.frames(), count, show)
            if out.suffix.lower() == ".gif":
                write_gif(frames, out, fps, overwrite=force)
            else:
                crf = CRF if pictures.crf is None else pictures.crf
                write_mp4(frames, out, fps, crf=crf, overwrite=force)
            record = {"animation": out, "frames": count, "fps": fps, "bytes": out.stat().st_size}
            print_result(record, str(out), as_json=as_json)
            print_message(f"{count} frames, {count / fps:.1f} s, {out.stat().st_size / 1e6:.1f} MB")


def tracked(items: Iterable[Item], count: int, show: Show) -> Iterator[Item]:
    """The items, each shown as a step when the next one is asked for."""
    from gsedit.reports.events import Event
    from gsedit.reports.stopwatch import Stopwatch

    watch = Stopwatch()
    for step, item in enumerate(items, 1):
        yield item
        show(Event("render", watch.seconds, step, count))


def write_files(
    animation: Animation, index: int, stem: Path, pictures: PictureOptions, force: bool
) -> list[Path]:
    """Write the files of one view into a folder; their paths."""
    from gsedit.reports.rendered_views import save_frame, write_view

    if animation.wiped is not None:
        path = stem.with_name(f"{stem.name}.png")
        save_frame(animation.frame(index), path, overwrite=force)
        return [path]
    return write_view(
        animation.scene,
        animation.cameras[index],
        stem,
        show=animation.show,
        format=pictures.format.value,
        background=animation.background,
        transparent=pictures.transparent,
        numerics=animation.numerics[0],
        execution=animation.execution,
        overwrite=force,
    )


def write_one(animation: Animation, out: Path, pictures: PictureOptions, force: bool) -> None:
    """Write the first view into one file."""
    from gsedit.reports.rendered_views import save_frame, write_still
    from gsedit.views.maps import render_maps

    if animation.wiped is not None:
        save_frame(animation.frame(0), out, overwrite=force)
        return
    maps = render_maps(
        animation.scene,
        animation.cameras[0],
        animation.show,
        background=animation.background,
        numerics=animation.numerics[0],
        execution=animation.execution,
    )
    write_still(maps, animation.show, out, transparent=pictures.transparent, overwrite=force)
