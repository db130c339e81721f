"""Frames of a video, decoded one at a time (PyAV)."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import UInt8

from gsedit.errors import InputError
from gsedit.runs.environment import load_extra
from gsedit.storage.inputs import existing_file

COMPLETE = 0.95
"""Share of the length that the file states, below which it counts as cut off."""
UNSPECIFIED = 2
"""AVCOL_SPC_UNSPECIFIED: the file does not name its color matrix."""
HIGH_DEFINITION = 720
"""Lines from which such a video is taken as BT.709 instead of BT.601."""

TRUSTED = {
    "format_whitelist": "mov,mp4,matroska,webm,avi,mpegts,mpeg,mpegvideo,flv,asf,ogg,gif",
    "protocol_whitelist": "file",
}
"""FFmpeg goes by the content of a file, whatever its name: play lists and other formats that name
files or addresses are not opened."""


@dataclass(frozen=True, eq=False)
class Decoded:
    """A frame as it was decoded; its pixels are made when they are asked for."""

    index: int
    """From 0, of the frames that could be decoded."""
    stamp: int
    """Its time in the file's own units, the same whenever it is decoded; where the file has none,
    the index."""
    seconds: float
    picture: Any
    aspect: float = 1.0
    """Width of a stored pixel in its height."""

    def rgb(self, size: int) -> UInt8[np.ndarray, "h w 3"]:
        """sRGB as it is shown, its longer side at most `size` pixels."""
        return self._pixels("rgb24", size)

    def grey(self, size: int) -> UInt8[np.ndarray, "h w"]:
        """Luma as it is shown, its longer side at most `size` pixels."""
        return self._pixels("gray", size)

    def _pixels(self, format: str, size: int) -> np.ndarray:
        picture = self.picture
        width, height = picture.width * self.aspect, picture.height
        scale = min(1.0, size / max(width, height))
        high = picture.colorspace == UNSPECIFIED and picture.height >= HIGH_DEFINITION
        pixels = picture.reformat(
            width=max(1, round(width * scale)),
            height=max(1, round(height * scale)),
            format=format,
            src_colorspace="ITU709" if high else None,
            dst_color_range="JPEG",
            interpolation="AREA",
        ).to_ndarray()
        return np.ascontiguousarray(np.rot90(pixels, round(picture.rotation / 90)))


class Video:
    """An open video; `frames` may be read once."""

    def __init__(self, path: Path, container: Any, stream: Any) -> None:
        self.path = path
        self.container, self.stream = container, stream
        self.broken = 0
        """Packets that could not be decoded."""
        self.last = 0.0
        """Seconds from the beginning, of the last frame."""

    @property
    def length(self) -> float:
        """Seconds, as the file states; 0 where it does not."""
        if self.stream.duration and self.stream.time_base:
            return float(self.stream.duration * self.stream.time_base)
        return (self.container.duration or 0) / 1e6

    @property
    def count(self) -> int:
        """How many frames it should have, about; 0 where the file does not tell."""
        return self.stream.frames or round(self.length * float(self.stream.average_rate or 0))

    def frames(self) -> Iterator[Decoded]:
        """The frames in the order of their times; those that are damaged are left out."""
        start = None
        aspect = float(self.stream.sample_aspect_ratio or 1)
        for index, picture in enumerate(self._pictures()):
            at = picture.time if picture.time is not None else self.last
            start = at if start is None else start
            self.last = max(self.last, at - start)
            stamp = index if picture.pts is None else picture.pts
            yield Decoded(index, stamp, self.last, picture, aspect)

    def notes(self) -> tuple[str, ...]:
        """Notes on the video once its frames were read."""
        if self.length and self.last < COMPLETE * self.length - 0.5:
            return (
                f"{self.path} is cut off: {self.last:.1f} of {self.length:.1f} s can be decoded, "
                "and are used",
            )
        if self.broken:
            return (f"{self.path}: {self.broken} damaged parts of it were left out",)
        return ()

    def _pictures(self) -> Iterator[Any]:
        import av.error

        packets = self.container.demux(self.stream)
        while True:
            try:
                pictures = next(packets).decode()
            except StopIteration:
                return
            except av.error.EOFError:
                return
            except av.error.InvalidDataError:
                self.broken += 1
                continue
            except av.error.FFmpegError:  # reading failed: there is no more
                self.broken += 1
                return
            yield from (picture for picture in pictures if not picture.is_corrupt)


@contextmanager
def open_video(path: Path) -> Iterator[Video]:
    """A video. Raises InputError for a file that is none, GseditError without PyAV."""
    av = load_extra("av", "a video", "give a folder of photos")
    try:
        container = av.open(str(existing_file(path)), container_options=TRUSTED)
    except av.error.FFmpegError as error:
        raise InputError(_not_opened(path, error)) from None
    with container:
        if not container.streams.video:
            raise InputError(f"{path} has no pictures in it (sound only?): name a video")
        stream = container.streams.video[0]
        stream.thread_type = "AUTO"
        yield Video(path, container, stream)


def _not_opened(path: Path, error: Exception) -> str:
    mp4 = path.suffix.lower() in (".mp4", ".mov", ".m4v", ".3gp")
    ends = _ends(path)
    if mp4 and b"ftyp" in ends[:64] and b"moov" not in ends:
        return (
            f"{path} is cut off: its index, which comes last, is missing; copy it again from the "
            "camera, or repair it with a tool such as untrunc"
        )
    reason = str(getattr(error, "strerror", "") or error)
    return f"{path} is no video that can be read ({reason}): export it again as MP4 (H.264)"


def _ends(path: Path) -> bytes:
    """The first and last bytes of a file, where an MP4 keeps its index."""
    with path.open("rb") as file:
        first = file.read(1 << 20)
        file.seek(max(0, path.stat().st_size - (1 << 22)))
        return first + file.read()
