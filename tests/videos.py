"""Small videos for tests: a textured wall that passes by."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from fractions import Fraction
from pathlib import Path

import numpy as np
from PIL import Image, ImageFilter

from gsedit.pictures.animations import Frame, converter_flags

SIZE = (96, 64)


def texture(width: int = 900, height: int = 64, seed: int = 0) -> Image.Image:
    """Blobs of several sizes."""
    rng = np.random.default_rng(seed)
    total = np.zeros((height, width, 3))
    for cell in (16, 4, 1):
        channels = 3 if cell == 16 else 1  # H.264 halves the resolution of color
        coarse = rng.random((height // cell + 2, width // cell + 2, channels)).repeat(
            3 // channels, 2
        )
        levels = Image.fromarray((255 * coarse).astype(np.uint8))
        large = levels.resize((width, height), Image.Resampling.BICUBIC)
        total += np.asarray(large) / 3
    return Image.fromarray(total.astype(np.uint8))


def passing(offsets: Iterable[int], blurred: Iterable[int] = ()) -> list[np.ndarray]:
    """Frames of the wall, seen from `offsets` pixels to the right; those of the indices `blurred`
    are unsharp."""
    wall, blurred, frames = texture(), set(blurred), []
    for i, x in enumerate(offsets):
        frame = wall.crop((x, 0, x + SIZE[0], SIZE[1]))
        if i in blurred:
            frame = frame.filter(ImageFilter.GaussianBlur(2))
        frames.append(np.asarray(frame))
    return frames


def write_video(
    path: Path,
    frames: list[np.ndarray],
    fps: int = 10,
    turn: int = 0,
    times: list[float] | None = None,
    faststart: bool = True,
) -> Path:
    """Write frames; `turn`: degrees of the rotation in the metadata; `times`: of a variable rate,
    seconds."""
    import av

    options = {"movflags": "+faststart"} if faststart else {}
    with av.open(str(path), "w", options=options) as container:
        stream = container.add_stream("libx264", rate=fps)
        stream.height, stream.width = frames[0].shape[:2]
        stream.pix_fmt = "yuv420p"
        stream.options = {"crf": "12", "g": "10", "bf": "0"}
        if turn:
            stream.set_display_rotation(turn)
        clock = Fraction(1, 1000)
        stream.codec_context.time_base = clock
        for i, frame in enumerate(frames):
            picture = av.VideoFrame.from_ndarray(np.ascontiguousarray(frame), format="rgb24")
            seconds = i / fps if times is None else times[i]
            picture.pts, picture.time_base = round(seconds / clock), clock
            container.mux(stream.encode(picture))
        container.mux(stream.encode(None))
    return path


def read_frames(path: str | Path) -> Iterator[Frame]:
    """The frames of an MP4 that gsedit wrote, to compare with those that went in."""
    import av

    with av.open(str(path)) as container:
        for frame in container.decode(video=0):
            converted = frame.reformat(
                format="rgb24",
                src_colorspace="ITU709",
                dst_colorspace="ITU709",
                src_color_range="MPEG",
                dst_color_range="JPEG",
                interpolation=converter_flags("BICUBIC", "FULL_CHR_H_INT"),
            )
            yield converted.to_ndarray()
