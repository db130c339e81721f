"""Frames of an MP4 that gsedit wrote, to compare with those that went in."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import av

from gsedit.pictures.animations import Frame, converter_flags


def read_frames(path: str | Path) -> Iterator[Frame]:
    """The frames of an MP4, decoded."""
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
