"""Facts about the camera in a photo's header: EXIF 2.32 (CIPA DC-008) and Apple's maker note.

Sizes and directions are those of the photo as it is shown: its EXIF orientation applied. Prepared
photos of one camera are a group, with what is known of it.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from gsedit.capture.photos import Photo, register_heif
from gsedit.capture.settings import LENSES, CaptureSettings
from gsedit.formats.pictures import decoded, picture_size

FocalSource = Literal["EXIF 35 mm", "EXIF and sensor", "guessed"]
FULL_FRAME_DIAGONAL = 43.267
"""Millimetres, of 36 x 24: the 35 mm equivalent keeps the angle of the diagonal (CIPA DCG-001)."""
UNITS = {2: 25.4, 3: 10.0, 4: 1.0, 5: 0.001}
"""Millimetres, by FocalPlaneResolutionUnit: inch, centimetre, millimetre, micrometre."""
PLAUSIBLE = (0.3, 20.0)
"""Focal length in longer sides of the picture (118 to 3 degrees): tags beyond are mistakes."""
TURNS = {3: 2, 4: 2, 5: 1, 6: 3, 7: 3, 8: 1}
"""Quarter turns counter-clockwise that show a photo of this EXIF orientation upright, after the
mirroring of those in MIRRORED."""
MIRRORED = {2, 4, 5, 7}
REST = (0.8, 1.2)
"""Lengths of the acceleration, in g, of a phone that is held still enough to show gravity."""


@dataclass(frozen=True)
class Tags:
    """Facts that one photo's header holds."""

    width: int
    """As it is shown, pixels."""
    height: int
    camera: tuple[str, ...]
    """Make, model and lens, as far as they are known."""
    focal: float | None
    """Focal length in pixels."""
    focal_source: FocalSource
    gravity: tuple[float, float, float] | None
    """Unit vector towards the ground in OpenCV camera axes (x right, y down, z forward)."""


def camera_groups(photos: Sequence[Path]) -> tuple[dict[Path, Tags], ...]:
    """The photos of each camera (body, lens, focal length and size), in the order of their first
    photos; where they name no camera, each folder has its own. Raises InputError for a file that
    is no picture."""
    groups: dict[tuple[Any, ...], dict[Path, Tags]] = {}
    for photo in photos:
        tags = read_tags(photo)
        focal = None if tags.focal is None else round(tags.focal, 1)
        key = (tags.camera or photo.parent, tags.width, tags.height, focal)
        groups.setdefault(key, {})[photo] = tags
    return tuple(groups.values())


def read_tags(photo: Path) -> Tags:
    """Read the facts in a photo's header. Damaged tags count as absent; raises InputError for a
    file that is no picture."""
    register_heif()
    width, height = picture_size(photo)
    main, more, turned = _directories(photo)
    orientation = turned or main.get(0x0112, 1)
    orientation = orientation if orientation in range(1, 9) else 1
    focal, source = focal_length(more, width, height)
    if orientation >= 5 and not turned:
        width, height = height, width
    named = (main.get(0x010F), main.get(0x0110), more.get(0xA434))
    camera = tuple(str(text).strip("\0 ") for text in named if text)
    return Tags(
        width, height, camera, focal, source,
        gravity(more.get(0x927C), orientation, camera),
    )  # fmt: skip


def _directories(photo: Path) -> tuple[dict[int, Any], dict[int, Any], int | None]:
    """The main EXIF directory of a picture and that of its camera, empty where damaged; and the
    orientation that is applied already (HEIC)."""
    try:
        with decoded(photo) as picture:
            exif = picture.getexif()
            turned = picture.info.get("original_orientation")
            return dict(exif), dict(exif.get_ifd(0x8769)), turned
    except Exception:  # Pillow's readers raise a dozen kinds
        return {}, {}, None


def focal_length(tags: dict[int, Any], width: int, height: int) -> tuple[float | None, FocalSource]:
    """The focal length in pixels, and where it comes from, of a photo of `width` x `height`.

    Of FocalLengthIn35mmFilm, else of FocalLength and the sensor's resolution.
    """
    longer = max(width, height)
    equivalent = _number(tags.get(0xA405))
    if equivalent:
        focal = equivalent / FULL_FRAME_DIAGONAL * math.hypot(width, height)
        if _plausible(focal / longer):
            return focal, "EXIF 35 mm"
    length, per_unit = _number(tags.get(0x920A)), _number(tags.get(0xA20E))
    unit = UNITS.get(tags.get(0xA210, 2))
    if length and per_unit and unit:
        # the resolution is that of the photo as taken; it may have been shrunk since
        taken = max(_number(tags.get(tag)) or 0 for tag in (0xA002, 0xA003)) or longer
        focal = length * per_unit / unit * longer / taken
        if _plausible(focal / longer):
            return focal, "EXIF and sensor"
    return None, "guessed"


def gravity(
    note: bytes | None, orientation: int, camera: Sequence[str] = ()
) -> tuple[float, float, float] | None:
    """Downward direction in camera axes, from the acceleration in an iPhone's maker note.

    Apple's axes, seen from the front of the phone: x right, y top, z towards the viewer; at rest
    the vector points to the ground. The pixels are stored as the phone sees held with its top to
    the left: their x is Apple's -y, their y is -x, and the back camera looks along -z. None where
    the note has no vector, for the front camera, and for a phone that was moved too fast.
    """
    values = None if note is None else _acceleration(note)
    if values is None or any("front" in text.lower() for text in camera):
        return None
    length = math.hypot(*values)
    if not REST[0] <= length <= REST[1]:
        return None
    x, y, z = (-values[1] / length, -values[0] / length, -values[2] / length)
    x, y = shown(x, y, orientation)
    return x, y, z


def shown(x: float, y: float, orientation: int) -> tuple[float, float]:
    """A direction in the stored pixels (x right, y down), in the photo as it is shown."""
    if orientation in MIRRORED:
        x = -x
    for _ in range(TURNS.get(orientation, 0)):
        x, y = y, -x
    return x, y


def _acceleration(note: bytes) -> tuple[float, ...] | None:
    """Tag 8 of Apple's maker note: three signed rationals, in g. The note is a TIFF directory;
    its offsets count from its own beginning."""
    if not note.startswith(b"Apple iOS\0"):
        return None
    order = "<" if note[12:14] == b"II" else ">"
    try:
        (entries,) = struct.unpack_from(order + "H", note, 14)
        for i in range(entries):
            tag, kind, count, offset = struct.unpack_from(order + "HHII", note, 16 + 12 * i)
            if (tag, kind, count) == (8, 10, 3):
                numbers = struct.unpack_from(order + "6i", note, offset)
                return tuple(a / b for a, b in zip(numbers[::2], numbers[1::2]))
    except (struct.error, ZeroDivisionError):
        return None
    return None


def _number(value: Any) -> float | None:
    """A positive finite number, else None."""
    try:
        number = float(value)
    except (TypeError, ValueError, ZeroDivisionError):
        return None
    return number if math.isfinite(number) and number > 0 else None


def _plausible(ratio: float) -> bool:
    return PLAUSIBLE[0] <= ratio <= PLAUSIBLE[1]


@dataclass(frozen=True)
class Group:
    """Prepared photos of one camera."""

    names: tuple[str, ...]
    width: int
    height: int
    focal: float | None
    """Pixels of the prepared photos."""
    source: str
    gravities: Mapping[str, tuple[float, float, float] | None]

    def request(self, lens: str) -> dict[str, Any]:
        """As `worker.extract` takes it."""
        model, focals, distortions = LENSES[lens]
        params = None
        if self.focal is not None:
            middle = [self.width / 2, self.height / 2]
            params = [self.focal] * focals + middle + [0.0] * distortions
        return {"names": self.names, "model": model, "params": params}


def groups_of(photos: Sequence[Photo], settings: CaptureSettings) -> tuple[Group, ...]:
    """The prepared photos by camera."""
    by_source = {Path(photo.source): photo for photo in photos}
    return tuple(
        _group(group, [by_source[path] for path in group], settings)
        for group in camera_groups(list(by_source))
    )


def _group(group: dict[Path, Tags], photos: Sequence[Photo], settings: CaptureSettings) -> Group:
    first, shown = photos[0], next(iter(group.values()))
    focal, source = shown.focal, shown.focal_source
    if settings.focal is not None:
        diagonal = math.hypot(shown.width, shown.height)
        focal, source = settings.focal / FULL_FRAME_DIAGONAL * diagonal, "--focal"
    return Group(
        tuple(photo.name for photo in photos), first.width, first.height,
        None if focal is None else focal * first.width / shown.width, source,
        {photo.name: tags.gravity for photo, tags in zip(photos, group.values())},
    )  # fmt: skip
