"""Bad captures end in one line that names the cause and the next move."""

import shutil

import numpy as np
import pytest
from command_line import gsedit, one_line
from lens_photos import RealLens, take, turn, walk
from PIL import Image

from gsedit.capture.causes import Evidence, hopeless


def failure(folder, out, *words):
    """The last line on stderr of a capture that fails as unreadable input does."""
    result = gsedit("capture", folder, "-o", out, "--threads", 2, *words)
    assert result.exit_code == 3, result.stderr
    assert "Traceback" not in result.stderr
    line = result.stderr.splitlines()[-1]
    assert line.startswith(f"gsedit: {folder}")
    return line


def copies(folder, photo, count):
    folder.mkdir(parents=True)
    for i in range(count):
        shutil.copy(photo, folder / f"{i}.jpg")


def grey_photos(folder, size, levels):
    folder.mkdir()
    for i, level in enumerate(levels):
        Image.new("L", (size, size), level).save(folder / f"{i}.png")


def floating_photos(folder):
    folder.mkdir()
    for i in range(2):
        Image.new("F", (96, 96)).save(folder / f"{i}.tif")


def made_before(folder):
    folder.mkdir()
    (folder / "capture.json").write_text("{}")


def heic_photos(folder):
    folder.mkdir()
    for i in range(4):
        (folder / f"{i}.HEIC").write_bytes(b"\0\0\0\x18ftypheic" + bytes(64))


@pytest.fixture(scope="module")
def photo(tmp_path_factory):
    folder = tmp_path_factory.mktemp("one")
    take(folder, walk(1), RealLens(96, 96, 80.0))
    return folder / "photo_00.jpg"


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda folder, photo: copies(folder, photo, 5), "all 5 photos are the same picture"),
        (lambda folder, photo: copies(folder, photo, 2), "2 photos cannot make a scene: walk"),
        (lambda folder, _: grey_photos(folder, 96, range(5)), "5 of 5 photos are black or of one"),
        (lambda folder, _: grey_photos(folder, 1, range(5)), "1x1 pixels, 64 are needed"),
        (lambda folder, _: heic_photos(folder), "left out): copy or export these files again"),
        (
            lambda folder, _: floating_photos(folder),
            "export it with 8 or 16 bits) left out): copy or export these files again",
        ),
        (lambda folder, _: folder.mkdir(), "holds no photos"),
        (lambda folder, photo: copies(folder / "masks", photo, 2), "but in "),
        (lambda folder, _: made_before(folder), "is what gsedit capture wrote: name it for gsedit"),
        (lambda folder, _: (folder.mkdir(), (folder / "a.mov").touch()), "a.mov itself"),
    ],
    ids=[
        "same",
        "two",
        "black",
        "tiny",
        "heic",
        "floats",
        "empty",
        "masks",
        "captured",
        "video inside",
    ],
)
def test_photos_that_can_make_no_scene(make, said, photo, tmp_path):
    make(tmp_path / "photos", photo)
    assert said in failure(tmp_path / "photos", tmp_path / "scene")


def test_a_camera_that_turned_on_the_spot(tmp_path):
    take(tmp_path / "photos", turn(5), RealLens(200, 200, 160.0))
    line = failure(tmp_path / "photos", tmp_path / "scene", "--set", "features=600")
    assert "the camera turned on the spot and did not walk" in line
    assert "a step sideways" in line


def test_photos_that_do_not_overlap(tmp_path):
    take(tmp_path / "photos", walk(4), RealLens(160, 160, 200.0))
    words = ("--set", "features=400", "--no-retries")
    line = failure(tmp_path / "photos", tmp_path / "scene", *words)
    assert "none of 4 photos could be posed: too little overlap" in line
    assert "take photos in between" in line


def evidence(pairs, features=1000, focal_known=True, count=10):
    names = [str(i) for i in range(count)]
    return Evidence({name: features for name in names}, pairs, focal_known)


def pair(i, j, inliers=200, homography=None, shift=0.1):
    flat = homography is not None
    return {"names": (str(i), str(j)), "inliers": inliers, "flat": flat, "shift": shift,
            "homography": homography.tolist() if flat else None}  # fmt: skip


def homographies(focal, translation):
    """Homographies of a camera that turns by 10, 20, ... degrees, before a wall one unit away."""
    inner = np.diag([focal, focal, 1.0])
    for degrees in range(10, 60, 10):
        c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
        turned = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
        moved = turned + np.outer((translation * degrees / 30, 0, 0), (0, 0, 1))
        yield inner @ moved @ np.linalg.inv(inner)


@pytest.mark.parametrize("focal", [0.5, 1.3])
def test_homographies_that_are_rotations_mean_that_the_camera_turned(focal):
    turned = [pair(i, i + 1, homography=h) for i, h in enumerate(homographies(focal, 0.0))]
    assert "turned on the spot" in str(hopeless(evidence(turned)))
    wall = [pair(i, i + 1, homography=h) for i, h in enumerate(homographies(focal, 0.5))]
    assert hopeless(evidence(wall)) is None
    walked = [pair(i, j) for i in range(5) for j in range(5, 10)]
    assert hopeless(evidence(turned + walked)) is None


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (("nothing", "-o", "scene"), 3, "nothing does not exist"),
        (("photos", "-o", "photos"), 2, "would replace the photos"),
        (("scene/images", "-o", "scene"), 2, "would replace the photos"),
        (("scene/images/inner", "-o", "scene", "-f"), 2, "would replace the photos"),
        (("scene/images/a.mov", "-o", "scene", "-f"), 2, "would replace scene/images/a.mov"),
        (("photos", "-o", "."), 2, "has files in it already"),
        (("photos", "-o", ".", "-f"), 2, "holds work, which no capture made"),
        (("photos", "-o", "full"), 2, "has files in it already"),
        (("a.txt", "-o", "scene"), 3, "neither a folder of photos nor a video"),
        (("photos", "-o", "new", "--size", "5"), 2, "--size is 5"),
        (("photos", "-o", "new", "--focal", "0"), 2, "--focal is 0"),
        (("photos", "-o", "new", "--frames", "9"), 2, "--frames 9 is for a video, and photos is"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, tuple) else "",
)
def test_requests_that_would_do_harm(words, code, said, photo, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("photos", "scene/images/inner", "full", "work"):
        (tmp_path / name).mkdir(parents=True)
        shutil.copy(photo, tmp_path / name)
    (tmp_path / "a.txt").touch()
    (tmp_path / "scene" / "images" / "a.mov").touch()
    before = sorted(tmp_path.rglob("*"))
    result = gsedit("capture", *words)
    assert result.exit_code == code
    assert said in result.stderr
    assert one_line(result.stderr)
    assert sorted(tmp_path.rglob("*")) == before
