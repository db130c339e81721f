"""A video as photos: of every stretch of it, the sharpest frame.

PyAV decodes it twice: once to measure every frame at a small size, once to write those chosen.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import UInt8
from PIL import Image

from gsedit.errors import InputError
from gsedit.run.atomic import atomic_path
from gsedit.run.environment import load_extra
from gsedit.run.events import Event
from gsedit.run.inputs import existing_file

SUFFIXES = (".mp4", ".mov", ".m4v", ".mkv", ".webm", ".avi", ".3gp", ".mts", ".m2ts")
PER_SECOND = 2.0
"""Frames for each second in which the picture moves: a walk around something takes a minute, and
120 photos of it are 3 degrees apart."""
STEP = 0.15
"""Shift between neighboring frames, in the picture's width, that must not be exceeded: a faster
video gets more frames."""
FEWEST, MOST = 40, 200
LONGEST_SIDE = 1920
"""Pixels; larger frames are shrunk: fits and edits use fewer, and features are found at 1,600."""
MEASURED_SIDE = 480
"""Pixels: the longer side at which sharpness is measured. Noise and compression are averaged away,
blur that a fit would show is not."""
QUALITY = 95
"""Quality of the JPEG files."""
SAME = 1.5
"""Mean difference of thumbnails, levels of 255, below which two frames are one picture: the noise
of compression on a still picture is below 1."""
FLAT = 3.0
"""Standard deviation of a thumbnail, levels: a frame below it is black, or shows nothing."""
MARGIN = 0.2
"""Share of a bucket, at each end, whose frames are taken only if no other is at hand. Otherwise the
sharpest frames of two neighbors could be one moment, with a gap beside them."""
BLURRED = 0.35
"""Sharpness in the median of the neighbors, below which a frame is called blurred."""
MANY_BLURRED = 0.1
"""Share of the frames from which the user is told."""
LEAST_FRAMES = 3
"""Different pictures: a video with fewer shows no scene from several sides."""


@dataclass(frozen=True)
class Frame:
    """A frame that was chosen."""

    name: str
    """Its file in the folder; names sort by time."""
    stamp: int
    """Time stamp as in `Decoded.stamp`."""
    seconds: float
    sharpness: float
    """Variance of the Laplacian at the measuring size, in the median of its neighbors'."""

    @property
    def blurred(self) -> bool:
        return self.sharpness < BLURRED


@dataclass(frozen=True)
class Extraction:
    """The frames of a video, and what is to be said of it."""

    frames: tuple[Frame, ...]
    paths: tuple[Path, ...]
    notes: tuple[str, ...]


def is_video(path: Path) -> bool:
    """By the suffix of its name."""
    return path.suffix.lower() in SUFFIXES


def extract_steps(
    video: Path, folder: Path, count: int | None = None
) -> Iterator[Event | Extraction]:
    """Write about `count` frames of a video into a folder as JPEG; events, then the result.

    None: as many as its length and its motion ask for. Each of `count` stretches of equal time
    gives its sharpest frame, except where the picture is still: it is taken once. Frames are turned
    as the video's metadata says, and at most LONGEST_SIDE pixels long. A video that is cut off
    gives what can be decoded, with a note.

    Raises InputError for a file that is no video, that is black, or that shows one still picture;
    GseditError without PyAV.
    """
    begun = time.monotonic()
    measured = []
    with open_video(video) as source:
        for frame in source.frames():
            measured.append(measure(frame))
            if len(measured) % 10 == 0:
                seconds = time.monotonic() - begun
                yield Event("video", seconds, len(measured), max(source.count, len(measured)))
        notes = source.notes()
    check_content(measured, video)
    chosen = choose(measured, count)
    notes = (*notes, *blur_notes(chosen, video))
    names = {frame.stamp: frame.name for frame in chosen}
    with open_video(video) as source:
        for done, name in enumerate(_write(source, folder, names), 1):
            note = f"the sharpest of each stretch: {name}"
            yield Event("frames", time.monotonic() - begun, done, len(names), note=note)
    written = tuple(frame for frame in chosen if (folder / frame.name).is_file())
    if lost := len(chosen) - len(written):  # damage is not decoded alike each time
        notes = (*notes, f"{video}: {lost} of {len(chosen)} frames could not be decoded again")
    yield Extraction(written, tuple(folder / frame.name for frame in written), notes)


@dataclass(frozen=True, eq=False)
class Measured:
    """A frame of which only what is needed for the choice is kept."""

    index: int
    stamp: int
    seconds: float
    sharpness: float
    thumbnail: UInt8[np.ndarray, "h w"]


def measure(frame: Decoded) -> Measured:
    """The variance of the Laplacian of a small grey picture, and a thumbnail."""
    small = frame.grey(MEASURED_SIDE)
    grey = small.astype(np.float32)
    inner = grey[1:-1, 1:-1]
    around = grey[:-2, 1:-1] + grey[2:, 1:-1] + grey[1:-1, :-2] + grey[1:-1, 2:]
    sharpness = float(np.var(around - 4 * inner)) if inner.size else 0.0
    picture = Image.fromarray(small)
    picture.thumbnail((64, 64), Image.Resampling.BOX)
    return Measured(frame.index, frame.stamp, frame.seconds, sharpness, np.asarray(picture))


def check_content(measured: Sequence[Measured], video: Path) -> None:
    """Raise InputError for a video without a frame, a black one, or a still one."""
    if not measured:
        raise InputError(
            f"{video}: no frame of it can be decoded; export it again as MP4 (H.264), or copy it "
            "again if the copy was cut off"
        )
    deviations = np.array([frame.thumbnail.std() for frame in measured])
    if (deviations < FLAT).all():
        black = max(float(frame.thumbnail.mean()) for frame in measured) < 40
        what = "is black" if black else "shows one plain color"
        raise InputError(f"{video} {what} from beginning to end: record it again, with light")
    if len(distinct([f for f, d in zip(measured, deviations) if d >= FLAT])) < LEAST_FRAMES:
        raise InputError(
            f"{video} shows one still picture: record it while walking around the subject"
        )


def distinct(frames: Sequence[Measured]) -> tuple[Measured, ...]:
    """The frames that differ from the one taken before them; of the same picture, the sharpest."""
    taken: list[Measured] = []
    anchors: list[UInt8[np.ndarray, "h w"]] = []
    for frame in frames:
        if anchors and _difference(anchors[-1], frame.thumbnail) < SAME:
            if frame.sharpness > taken[-1].sharpness:
                taken[-1] = frame
        else:
            taken.append(frame)
            anchors.append(frame.thumbnail)
    return tuple(taken)


def choose(measured: Sequence[Measured], count: int | None) -> tuple[Frame, ...]:
    """The sharpest frame of each of `count` stretches of equal time in which the picture moves.

    None: PER_SECOND, more where the picture moves faster than STEP between them. A stretch that
    holds a frame gives one, sharp or not: without it, those around it may not connect.
    """
    textured = [frame for frame in measured if frame.thumbnail.std() >= FLAT]
    moving, seconds = _moving_time(textured)
    if count is None:
        path = _path(textured)
        wanted = max(PER_SECOND * seconds, path / STEP)
        count = min(MOST, max(FEWEST, round(wanted)))
    buckets: dict[int, list[tuple[float, Measured]]] = {}
    for frame, at in zip(textured, moving):
        place = min(at / max(seconds, 1e-9), 1 - 1e-9) * count
        buckets.setdefault(int(place), []).append((place % 1, frame))
    best = [_sharpest(frames) for _, frames in sorted(buckets.items())]
    best = distinct(best)
    return tuple(
        Frame(
            f"frame_{frame.index:06d}.jpg", frame.stamp, round(frame.seconds, 3), round(relative, 3)
        )
        for frame, relative in zip(best, _relative([frame.sharpness for frame in best]))
    )


def _relative(sharpness: Sequence[float]) -> list[float]:
    """Each in the median of itself and four on either side: neighbors show nearly the same."""
    medians = [np.median(sharpness[max(0, i - 4) : i + 5]) for i in range(len(sharpness))]
    return [float(each / max(median, 1e-9)) for each, median in zip(sharpness, medians)]


def blur_notes(frames: Sequence[Frame], video: Path) -> tuple[str, ...]:
    """Notes on blurred frames, where they are many. They are used all the same:
    docs/measurements/capture.md has what leaving them out would lose."""
    blurred = sum(frame.blurred for frame in frames)
    if blurred <= MANY_BLURRED * len(frames):
        return ()
    return (
        f"{video}: {blurred} of {len(frames)} frames are blurred, and no sharp one is near: walk "
        "more slowly, or with more light",
    )


def _sharpest(bucket: Sequence[tuple[float, Measured]]) -> Measured:
    inner = [frame for place, frame in bucket if MARGIN <= place <= 1 - MARGIN]
    return max(inner or [frame for _, frame in bucket], key=lambda frame: frame.sharpness)


def _moving_time(frames: Sequence[Measured]) -> tuple[list[float], float]:
    """The time in the middle of each frame, and at the end, of a clock that stands while the
    picture does."""
    step = float(np.median(np.diff([frame.seconds for frame in frames])))
    at, clock, anchor = [], 0.0, 0
    for i, frame in enumerate(frames):
        if i and _difference(frames[anchor].thumbnail, frame.thumbnail) >= SAME:
            # still for longer than a second: the clock stood
            clock += min(frame.seconds - frames[anchor].seconds, 1.0)
            anchor = i
        at.append(clock + step / 2)
    return at, clock + step


def _path(frames: Sequence[Measured]) -> float:
    """How far the picture moved in all, in its width: shifts by phase correlation between frames a
    tenth of a second apart."""
    total, last = 0.0, frames[0]
    for frame in frames[1:]:
        if frame.seconds - last.seconds >= 0.1:
            total += _shift(last.thumbnail, frame.thumbnail)
            last = frame
    return total


def _shift(a: UInt8[np.ndarray, "h w"], b: UInt8[np.ndarray, "h w"]) -> float:
    """The displacement that explains most of the change between two pictures, in their width."""
    height, width = a.shape
    window = np.outer(np.hanning(height), np.hanning(width))
    first, second = (np.fft.rfft2((x - x.mean()) * window) for x in (a, b))
    cross = first * second.conj()
    correlation = np.fft.irfft2(cross / np.maximum(np.abs(cross), 1e-9), s=a.shape)
    dy, dx = np.unravel_index(int(correlation.argmax()), a.shape)
    dy, dx = min(dy, height - dy), min(dx, width - dx)
    return float(np.hypot(dy, dx)) / width


def _difference(a: UInt8[np.ndarray, "h w"], b: UInt8[np.ndarray, "h w"]) -> float:
    return float(np.abs(a.astype(np.int16) - b).mean())


def _write(source: Video, folder: Path, names: dict[int, str]) -> Iterator[str]:
    """Write the frames of these stamps; the name of each once its file is there."""
    left = dict(names)
    for frame in source.frames():
        if (name := left.pop(frame.stamp, None)) is not None:
            picture = Image.fromarray(frame.rgb(LONGEST_SIDE))
            with atomic_path(folder / name, overwrite=True) as temporary:
                picture.save(temporary, "JPEG", quality=QUALITY, subsampling=0)
            yield name
        if not left:  # not by the stamps: those of a damaged file may go back
            return


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
    with path.open("rb") as file:  # an MP4 keeps its index at one of its ends
        ends = file.read(1 << 20)
        file.seek(max(0, path.stat().st_size - (1 << 22)))
        ends += file.read()
    if mp4 and b"ftyp" in ends[:64] and b"moov" not in ends:
        return (
            f"{path} is cut off: its index, which comes last, is missing; copy it again from the "
            "camera, or repair it with a tool such as untrunc"
        )
    reason = str(getattr(error, "strerror", "") or error)
    return f"{path} is no video that can be read ({reason}): export it again as MP4 (H.264)"
