"""Search for the photos of a folder and of its folders, and a line about what is left out."""

import pytest
from PIL import Image

from gsedit.capture.folder import find_photos
from gsedit.capture.photos import prepare


def photos(folder, *names, suffix=".jpg"):
    folder.mkdir(parents=True, exist_ok=True)
    for name in names:
        Image.new("RGB", (80, 64)).save(folder / (name + suffix))


@pytest.fixture
def phones(tmp_path):
    """Two phones of which each wrote its own folder, and one photo beside them."""
    top = tmp_path / "photos"
    photos(top, "first")
    photos(top / "phone 10", "IMG_1", "IMG_2")
    photos(top / "phone 2" / "DCIM", "IMG_1", "IMG_10", "IMG_9")
    return top


def test_photos_in_folders_are_read_in_the_order_of_the_folders(phones, tmp_path):
    found = find_photos(phones, tmp_path / "out")
    assert [each.relative_to(phones).as_posix() for each in found.files] == [
        "first.jpg", "phone 2/DCIM/IMG_1.jpg", "phone 2/DCIM/IMG_9.jpg",
        "phone 2/DCIM/IMG_10.jpg", "phone 10/IMG_1.jpg", "phone 10/IMG_2.jpg",
    ]  # fmt: skip
    (note,) = found.notes
    assert note == (
        f"6 photos of 3 folders: 1 in {phones}, 3 in {phones / 'phone 2' / 'DCIM'}, "
        f"2 in {phones / 'phone 10'}"
    )
    *_, last = prepare(found.files, tmp_path / "prepared", 1600, phones)
    names = [photo.name for photo in last.photos]
    assert names[:2] == ["first.jpg", "phone_2_DCIM_IMG_1.jpg"]
    assert len({name.lower() for name in names}) == 6
    assert not any(" " in name for name in names)


def test_what_is_left_out_is_named_with_counts(phones, tmp_path):
    photos(phones / "masks", "a", "b", suffix=".png")
    photos(phones / "images", "a")
    photos(phones / "images_4", "a")
    photos(phones / ".thumbnails", "a")
    photos(phones / "bronze", "before_after")
    (phones / "bronze" / "edit.json").write_text("{}")
    photos(phones / "interrupted" / "work" / "photos-1", "a")
    (phones / "interrupted" / "work" / "colmap.log").touch()
    (phones / "a.mov").touch()
    photos(phones / "out" / "images", "a")
    (phones / "again").symlink_to(phones, target_is_directory=True)
    found = find_photos(phones, phones / "out")
    assert len(found.files) == 7
    _, left, videos = found.notes
    for words in ("bronze (1 picture)", "images_4 (1 picture)", "masks (2 pictures)",
                  "work (1 picture)", "itself"):  # fmt: skip
        assert words in left
    assert "thumbnails" not in left
    assert videos.startswith("left out: 1 video (")


def test_links_out_of_the_folder_are_not_followed(tmp_path):
    top = tmp_path / "photos"
    photos(top, "a")
    photos(top / "more", "b")
    photos(tmp_path / "private", "c", "d")
    (top / "up").symlink_to(tmp_path, target_is_directory=True)
    (top / "away").symlink_to(tmp_path / "private", target_is_directory=True)
    (top / "within").symlink_to(top / "more", target_is_directory=True)
    found = find_photos(top, tmp_path / "out")
    assert sorted(file.name[0] for file in found.files) == ["a", "b"]
    assert any("away (2 pictures)" in note for note in found.notes)


def test_numbered_folders_are_smaller_copies_only_beside_the_photos(tmp_path):
    for day in ("photos_1", "photos_2"):
        photos(tmp_path / "walk" / day, "a", "b")
    found = find_photos(tmp_path / "walk", tmp_path / "out")
    assert len(found.files) == 4
    photos(tmp_path / "walk" / "photos", "a", "b")
    found = find_photos(tmp_path / "walk", tmp_path / "out")
    assert {each.parent.name for each in found.files} == {"photos"}
