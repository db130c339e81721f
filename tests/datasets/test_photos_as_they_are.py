"""Datasets as people have them: photos missing, turned, smaller, masked, of several sizes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from bad_files import dataset, write
from photo_sets import colmap_dataset
from PIL import Image

from gsedit import load_dataset
from gsedit.errors import InputError


def picture(path: Path, size: tuple[int, int], value: Any = 99) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.full((size[1], size[0], 3), value, np.uint8)).save(path)


def without(folder: Path, frames: int, missing: int) -> Path:
    record = dataset(folder, frames)
    for frame in record["frames"][:missing]:
        (folder / frame["file_path"]).unlink()
    return write(folder, record)


def test_photos_that_are_not_there_are_left_out_with_one_note(tmp_path):
    data = load_dataset(without(tmp_path, 12, 4))
    assert [view.name for view in data.views] == sorted(f"images/{i}.png" for i in range(4, 12))
    (note,) = data.notes
    for words in ("12 photos", "4 of them", "images/0.png, images/1.png", "other 8"):
        assert words in note


def test_photos_of_several_sizes_and_both_orientations(tmp_path):
    record = dataset(tmp_path)
    for i, (width, height) in enumerate([(8, 6), (6, 8), (20, 10)]):
        picture(tmp_path / f"images/{i}.png", (width, height))
        record["frames"][i] |= {"w": width, "h": height, "fl_x": 2.0 * width}
    views = load_dataset(write(tmp_path, record), size=8).views
    assert [tuple(v.image.shape) for v in views] == [(6, 8, 3), (8, 6, 3), (4, 8, 3)]
    assert [v.camera.fx for v in views] == [16, 12, 16]


def test_another_number_of_pixels_scales_the_intrinsics(tmp_path):
    record = dataset(tmp_path, size=(400, 301))
    record |= {"cx": 190.0, "cy": 150.0, "k1": 0.05}
    before = load_dataset(write(tmp_path, record)).views[0].camera
    for i in range(3):
        picture(tmp_path / f"images/{i}.png", (200, 150))  # 150.5, as other programs round it
    data = load_dataset(tmp_path)
    camera = data.views[0].camera
    assert (camera.width, camera.height) == (200, 150)
    assert camera.fx == pytest.approx(before.fx / 2, rel=0.01)  # other border pixels: other zoom
    assert (camera.cx, camera.cy) == pytest.approx((95, 150 * 150 / 301))
    (note,) = data.notes
    for words in ("3 photos", "200x150", "400x301", "scaled by 0.5"):
        assert words in note


@pytest.mark.parametrize("kind", ["nerfstudio", "colmap"])
def test_smaller_copies_are_read_where_they_are_enough(kind, tmp_path):
    if kind == "nerfstudio":
        write(tmp_path, dataset(tmp_path))
    else:
        colmap_dataset(tmp_path)
    for i in range(3):
        picture(tmp_path / f"images_2/{i}.png", (4, 3), 200)
    whole, half, quarter = (load_dataset(tmp_path, size=size) for size in (None, 4, 2))
    assert not whole.notes
    assert float(whole.views[1].image.mean()) == pytest.approx(40 / 255)
    for data in (half, quarter):
        assert float(data.views[1].image.mean()) == pytest.approx(200 / 255)
        assert "images_2 are 4x3" in data.notes[0]
    assert half.views[1].camera.fx == pytest.approx(whole.views[1].camera.fx / 2)
    assert [v.name for v in half.views] == [v.name for v in whole.views]


def test_a_photo_is_turned_by_exif_where_only_that_fits(tmp_path):
    record = dataset(tmp_path)
    stored = np.zeros((8, 6, 3), np.uint8)
    stored[0] = 255  # the first row: on the right side after a quarter turn clockwise
    exif = Image.Exif()
    exif[274] = 6
    Image.fromarray(stored).save(tmp_path / "images/1.png", exif=exif)
    view = load_dataset(write(tmp_path, record)).views[1]
    assert view.image.shape == (6, 8, 3)
    assert view.image[:, -1].min() == 1
    assert view.image[:, :-1].max() == 0
    Image.fromarray(stored).save(tmp_path / "images/1.png")
    with pytest.raises(InputError, match=r"1\.png is 6x8 .* 8x6: the proportions differ"):
        load_dataset(tmp_path)


@pytest.mark.parametrize("values", [(0, 255), (0, 1), (8, 250)])
@pytest.mark.parametrize("place", ["mask_path", "masks/1.png", "masks/1.png.png"])
def test_masks_are_found_by_every_convention(place, values, tmp_path):
    record = dataset(tmp_path)
    mask = np.full((3, 4), values[1], np.uint8)
    mask[:, :2] = values[0]
    file = tmp_path / ("other/hide.png" if place == "mask_path" else place)
    file.parent.mkdir()
    Image.fromarray(mask).save(file)
    if place == "mask_path":
        record["frames"][1]["mask_path"] = "other/hide.png"
    data = load_dataset(write(tmp_path, record))
    assert [view.mask is None for view in data.views] == [True, False, True]
    expected = torch.ones(6, 8, dtype=torch.bool)
    expected[:, :4] = False
    assert torch.equal(data.views[1].mask, expected)
    (note,) = data.notes
    assert f"1 of 3 photos have a mask ({file.parent.name}/)" in note


def test_colmap_masks_lie_beside_the_images(tmp_path):
    folder = colmap_dataset(tmp_path)
    picture(folder / "masks/2.png.png", (8, 6), 0)
    last = load_dataset(folder).views[2]
    assert last.mask is not None
    assert not last.mask.any()


def test_a_mask_is_undistorted_with_its_photo(tmp_path):
    """A bright disk in the photo, hidden by its mask: nothing of it is left outside the mask."""
    record = dataset(tmp_path, size=(80, 60)) | {"fl_x": 60.0, "k1": -0.2}
    y, x = np.mgrid[:60, :80]
    disk = (x - 60) ** 2 + (y - 40) ** 2 < 12**2
    Image.fromarray(np.where(disk[..., None], 255, np.zeros(3)).astype(np.uint8)).save(
        tmp_path / "images/1.png"
    )
    (tmp_path / "masks").mkdir()
    Image.fromarray(np.where(disk, 0, 255).astype(np.uint8)).save(tmp_path / "masks/1.png")
    for size in (80, 33):
        view = load_dataset(write(tmp_path, record), size=size).views[1]
        assert view.mask is not None
        assert view.image[view.mask].max() == 0
        assert view.image[~view.mask].min() < 1  # its border is there, and hidden
        assert 0.05 < float((~view.mask).float().mean()) < 0.3
