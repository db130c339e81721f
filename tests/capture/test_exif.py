"""Camera data that are read from photos, against files with known tags."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageOps

from gsedit.capture.exif import camera_groups, read_tags, shown

F35, FOCAL, RESOLUTION, UNIT, TAKEN, NOTE = 0xA405, 0x920A, 0xA20E, 0xA210, 0xA002, 0x927C
PHONE = {0x010F: "Apple", 0x0110: "iPhone 15"}


def apple_note(values, order=">") -> bytes:
    """A maker note of iOS with an acceleration vector; 1000ths of g."""
    mark = b"MM" if order == ">" else b"II"
    entries = [(1, 9, 1, 7), (8, 10, 3, 16 + 2 * 12 + 4)]
    directory = struct.pack(order + "H", 2)
    directory += b"".join(struct.pack(order + "HHII", *entry) for entry in entries)
    numbers = [n for value in values for n in (round(1000 * value), 1000)]
    return b"Apple iOS\0\0\1" + mark + directory + bytes(4) + struct.pack(order + "6i", *numbers)


def photo(path: Path, size=(400, 300), main=None, camera=None, color=90) -> Path:
    exif = Image.Exif()
    exif.update(main or {})
    exif.get_ifd(0x8769).update(camera or {})
    Image.new("RGB", size, (color, color, color)).save(path, exif=exif)
    return path


def test_the_35_mm_equivalent_keeps_the_angle_of_the_diagonal(tmp_path):
    tags = read_tags(photo(tmp_path / "a.jpg", (3600, 2400), camera={F35: 50}))
    assert tags.focal == pytest.approx(5000, rel=1e-3)  # 50 mm of 36 mm
    assert tags.focal_source == "EXIF 35 mm"


def test_the_sensor_gives_the_focal_length_of_a_shrunk_photo(tmp_path):
    # 4000 pixels on 20 mm; the photo was shrunk to a tenth
    camera = {FOCAL: 30.0, RESOLUTION: 2000.0, UNIT: 3, TAKEN: 4000}
    tags = read_tags(photo(tmp_path / "a.jpg", camera=camera))
    assert tags.focal == pytest.approx(600)
    assert tags.focal_source == "EXIF and sensor"


def test_photos_are_grouped_by_camera_focal_length_and_shown_size(tmp_path):
    phone, wide = {F35: 26}, {F35: 13}
    photos = [
        photo(tmp_path / "0.jpg", main=PHONE, camera=phone),
        photo(tmp_path / "1.jpg", main=PHONE, camera=wide),
        photo(tmp_path / "2.jpg", main=PHONE, camera=phone),
        photo(tmp_path / "3.jpg", main=PHONE | {0x0112: 6}, camera=phone),
        photo(tmp_path / "4.png"),
    ]
    groups = camera_groups(photos)
    assert [[path.name for path in group] for group in groups] == [
        ["0.jpg", "2.jpg"], ["1.jpg"], ["3.jpg"], ["4.png"]
    ]  # fmt: skip
    first = [next(iter(group.values())) for group in groups]
    assert [(tags.width, tags.height) for tags in first] == [
        (400, 300), (400, 300), (300, 400), (400, 300)
    ]  # fmt: skip
    assert first[0].focal == pytest.approx(2 * first[1].focal)


@pytest.mark.parametrize("orientation", range(1, 9))
def test_directions_turn_with_the_picture(orientation):
    """A white pixel right of a grey one, and a dark one below it, show where x and y went."""
    stored = np.full((5, 5), 0, np.uint8)
    stored[2, 2], stored[2, 3], stored[3, 2] = 100, 200, 50
    exif = Image.Exif()
    exif[0x0112] = orientation
    picture = Image.fromarray(stored)
    picture.info["exif"] = exif.tobytes()
    upright = np.asarray(ImageOps.exif_transpose(picture))

    def place(value):
        y, x = np.argwhere(upright == value)[0]
        return np.array([x, y])

    assert tuple(place(200) - place(100)) == shown(1.0, 0.0, orientation)
    assert tuple(place(50) - place(100)) == shown(0.0, 1.0, orientation)


@pytest.mark.parametrize(
    ("values", "orientation", "down"),
    [
        ((0, -1, 0), 6, (0, 1, 0)),  # held upright
        ((-1, 0, 0), 1, (0, 1, 0)),  # on its side, the top to the left
        ((1, 0, 0), 3, (0, 1, 0)),  # on its other side
        ((0, 0, -1), 1, (0, 0, 1)),  # the screen up: the camera looks down
        ((0, -0.8, -0.6), 6, (0, 0.8, 0.6)),  # upright, tipped forward
        ((-0.8, -0.6, 0), 1, (0.6, 0.8, 0)),
    ],
)
@pytest.mark.parametrize("order", "<>")
def test_the_acceleration_of_an_iphone_shows_the_ground(tmp_path, values, orientation, down, order):
    camera = {NOTE: apple_note(values, order)}
    path = photo(tmp_path / "a.jpg", main=PHONE | {0x0112: orientation}, camera=camera)
    assert read_tags(path).gravity == pytest.approx(down)


def test_the_photo_of_an_iphone_is_read_as_it_is_shown():
    """phone.heic: 96x64 pixels, orientation 6, 26 mm, held upright."""
    tags = read_tags(Path(__file__).parent / "phone.heic")
    assert (tags.width, tags.height) == (64, 96)
    assert tags.focal == pytest.approx(26 / 43.267 * np.hypot(64, 96))
    assert tags.gravity == pytest.approx((0, 1, 0))
    assert tags.camera == ("Apple", "iPhone 15")
