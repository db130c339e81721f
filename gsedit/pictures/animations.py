"""Moving pictures: MP4 (H.264, through PyAV), GIF and WebP (through Pillow), whole or not at all;
their frames: maps as 8-bit pictures side by side, all in one depth scale.

A frame is `h w 3` uint8, sRGB. Frames are taken one at a time, as they are rendered.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import chain, pairwise
from math import cos, tau
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, UInt8
from PIL import Image
from torch import Tensor

from gsedit.errors import UsageError
from gsedit.formats.pictures import eight_bits
from gsedit.pictures import MapName
from gsedit.pictures.maps import SOLID, Maps, depth_colors, depth_range, render_maps, wipe
from gsedit.run.atomic import atomic_path
from gsedit.run.environment import load_extra
from gsedit.views.dataset import evenly_spaced
from rasterizer.camera import Camera
from rasterizer.numerics import DEFAULT, Numerics
from rasterizer.scene import Gaussians

PROBES, PROBE_SIZE = 8, 96
"""Frames, and the longer side of their renders in pixels, that decide an animation's depth
scale."""


@dataclass(frozen=True, eq=False)
class Animation:
    """Pictures along a path of cameras of one size."""

    scene: Gaussians
    cameras: tuple[Camera, ...]
    show: tuple[MapName, ...] = ("color",)
    wiped: Gaussians | None = None
    """A second scene, parted from the first by a vertical line; then only color is shown."""
    moving: bool = True
    """Whether the line moves; else it is in the middle."""
    background: Float[Tensor, "3"] | None = None
    numerics: tuple[Numerics, Numerics] = (DEFAULT, DEFAULT)
    """Numerics of the scene and of the second one: `antialiased` where it was trained so."""

    def __len__(self) -> int:
        return len(self.cameras)

    def frames(self) -> Iterator[UInt8[np.ndarray, "h w 3"]]:
        """The frames, each rendered when it is asked for; their depths have one scale."""
        near_far = None
        if "depth" in self.show and self.wiped is None:
            near_far = depth_scale(self.scene, self.cameras, self.numerics[0])
        return (self.frame(index, near_far) for index in range(len(self)))

    def frame(
        self, index: int, near_far: tuple[float, float] | None = None
    ) -> UInt8[np.ndarray, "h w 3"]:
        """One frame; `near_far` are the ends of the depth scale (None: the frame's own)."""
        if self.wiped is not None:
            picture = wipe(
                self.scene, self.wiped, self.cameras[index], self.share(index),
                background=self.background, numerics=self.numerics,
            )  # fmt: skip
            return eight_bits(picture)
        return panels(self.maps(index), self.show, near_far)

    def maps(self, index: int) -> Maps:
        """The maps of one frame that are shown."""
        return render_maps(
            self.scene, self.cameras[index], self.show, background=self.background,
            numerics=self.numerics[0],
        )  # fmt: skip

    def share(self, index: int) -> float:
        """Share of a frame's width that shows the first scene: 1 to 0 and back."""
        return (1 + cos(tau * index / len(self))) / 2 if self.moving else 0.5


def panels(
    maps: Maps, show: Sequence[MapName], near_far: tuple[float, float] | None = None
) -> UInt8[np.ndarray, "h w 3"]:
    """The shown maps side by side; `near_far` are the ends of the depth scale (None: its own)."""
    return np.concatenate([_panel(maps, name, near_far) for name in show], 1)


def depth_scale(
    scene: Gaussians, cameras: Sequence[Camera], numerics: Numerics = DEFAULT
) -> tuple[float, float]:
    """The near and far ends of a color scale for all frames, from small renders of some."""
    depths, alphas = [], []
    for index in evenly_spaced(len(cameras), PROBES):
        small = cameras[index].fitted(PROBE_SIZE)
        maps = render_maps(scene, small, ("depth",), numerics=numerics)
        assert maps.depth is not None
        depths.append(maps.depth)
        alphas.append(maps.alpha)
    return depth_range(torch.cat(depths), torch.cat(alphas))


def normal_colors(maps: Maps) -> UInt8[np.ndarray, "h w 3"]:
    """Normals as colors: red right, green up, blue towards the viewer, -1 to 1; black where less
    than half of a pixel is covered."""
    assert maps.normals is not None
    return eight_bits((maps.normals / 2 + 0.5) * (maps.alpha > SOLID)[..., None])


def _panel(
    maps: Maps, name: MapName, near_far: tuple[float, float] | None
) -> UInt8[np.ndarray, "h w 3"]:
    match name:
        case "depth":
            assert maps.depth is not None
            near, far = near_far or depth_range(maps.depth, maps.alpha)
            return depth_colors(maps.depth, maps.alpha, near, far)
        case "normals":
            return normal_colors(maps)
        case "alpha":
            return np.repeat(eight_bits(maps.alpha)[..., None], 3, -1)
    return eight_bits(maps.color)


Frame = UInt8[np.ndarray, "h w 3"]

CODECS = ("libx264", "libopenh264", "mpeg4")
"""Encoders, the best first: not every build of FFmpeg has every one."""
MOST_FPS_GIF = 50
"""A GIF counts in hundredths of a second, and browsers slow down frames of less than two."""
QUALITY, WEBP_SIDE = 80, 16_383
"""A WebP's quality, 0, the smallest file, to 100; and the most pixels that a side can have."""


def check_format(path: Path, fps: float) -> None:
    """Raise UsageError for a frame rate that the format of `path` cannot hold, GseditError where
    MP4 files cannot be written: before the frames are rendered."""
    if path.suffix.lower() == ".mp4":
        _import()
    if path.suffix.lower() == ".gif" and fps > MOST_FPS_GIF:
        raise UsageError(f"--fps {fps:g}: a GIF shows at most {MOST_FPS_GIF}; write an .mp4")


def write_mp4(
    frames: Iterable[Frame],
    path: str | Path,
    fps: float,
    *,
    crf: int = 18,  # of 0 (the largest file) to 51: called visually lossless
    overwrite: bool = False,
) -> None:
    """Write frames of one size, of even width and height, as H.264 in BT.709, 4:2:0.

    Every player and browser shows it. Nothing is left where the frames end in an error or an
    interruption. Raises UsageError for no frames or odd sizes, and as `atomic_path` does;
    GseditError without PyAV.
    """
    av = _import()
    first, frames = _first(frames)
    height, width = first.shape[:2]
    if width % 2 or height % 2:
        raise UsageError(f"an MP4 needs even sides, these frames have {width}x{height} pixels")
    codec = next(name for name in CODECS if name in av.codecs_available)
    with atomic_path(path, overwrite=overwrite) as temporary:
        # faststart: the index comes first, so that a browser plays it while it loads
        options = {"movflags": "+faststart"}
        with av.open(str(temporary), "w", format="mp4", options=options) as container:
            stream = container.add_stream(codec, rate=Fraction(fps).limit_denominator(1001))
            stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
            stream.options = {"crf": str(crf)} if codec == "libx264" else {"qscale": "3"}
            context = stream.codec_context
            context.colorspace = context.color_primaries = context.color_trc = 1  # BT.709
            context.color_range = 1  # 16 to 235
            for frame in frames:
                picture = av.VideoFrame.from_ndarray(np.ascontiguousarray(frame), format="rgb24")
                converted = picture.reformat(
                    format="yuv420p",
                    src_colorspace="ITU709",
                    dst_colorspace="ITU709",
                    src_color_range="JPEG",
                    dst_color_range="MPEG",
                    interpolation=converter_flags("AREA", "FULL_CHR_H_INP"),
                )
                container.mux(stream.encode(converted))
            container.mux(stream.encode(None))


def write_loop(
    frames: Iterable[Frame], path: str | Path, fps: float, *, overwrite: bool = False
) -> None:
    """Write frames of one size as a .webp or .gif that repeats. A GIF has 256 colors a frame,
    dithered, and is about four times as large.

    A GIF's times are in hundredths of a second: single frames may be shown 5 ms too long or too
    short, all of them together are not. All frames are in memory. Raises UsageError for no frames,
    another suffix, a WebP beyond 16,383 pixels, more than 50 a second in a GIF, and as
    `atomic_path` does.
    """
    check_format(path := Path(path), fps)
    gif = path.suffix.lower() == ".gif"
    if not gif and path.suffix.lower() != ".webp":
        raise UsageError(f"{path}: name a .webp or a .gif")
    start, frames = _first(frames)
    if not gif and max(start.shape[:2]) > WEBP_SIDE:  # before the other frames are rendered
        raise UsageError(f"a WebP has at most {WEBP_SIDE} pixels a side: write an .mp4 or a .gif")
    first, *pictures = (_indexed(f) if gif else Image.fromarray(f) for f in frames)
    step = 10 if gif else 1
    ends = [step * round(1000 / step * i / fps) for i in range(len(pictures) + 2)]
    times = [end - start for start, end in pairwise(ends)]
    kind = {"format": "GIF", "optimize": False} if gif else {"format": "WEBP", "quality": QUALITY}
    with atomic_path(path, overwrite=overwrite) as temporary:
        first.save(temporary, save_all=True, append_images=pictures, duration=times, loop=0, **kind)


def _first(frames: Iterable[Frame]) -> tuple[Frame, Iterator[Frame]]:
    """The first frame, and all of them."""
    frames = iter(frames)
    first = next(frames, None)
    if first is None:
        raise UsageError("there are no frames to write: give 1 or more")
    return first, chain((first,), frames)


def converter_flags(*names: str) -> int:
    """Flags of FFmpeg's converter. Without ACCURATE_RND its colors are darker by half a step."""
    from av.video.reformatter import Interpolation

    return sum(int(Interpolation[name]) for name in (*names, "ACCURATE_RND"))


def _indexed(frame: Frame) -> Image.Image:
    picture = Image.fromarray(frame)
    # 2 dB nearer than median cut on renders, in a tenth of the time
    palette = picture.quantize(256, method=Image.Quantize.FASTOCTREE)
    return picture.quantize(palette=palette, dither=Image.Dither.FLOYDSTEINBERG)


def _import() -> Any:
    return load_extra("av", "an MP4 file", "write a .webp")
