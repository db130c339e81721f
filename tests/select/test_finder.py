"""Records of a finder on disk, and its refusal where a noun may be any of several objects."""

from __future__ import annotations

from dataclasses import asdict, replace

import numpy as np
import pytest
import torch
from PIL import Image
from point_clouds import cloud

from gsedit.editing.parts import SeveralObjects, check_alone
from gsedit.select.finder import LEAST, remembered
from gsedit.select.masked import read_masks
from gsedit.select.region import Region
from gsedit.select.segment import Segment, Segments
from gsedit.views.orbit import circle
from gsedit.views.undistort import Lens, undistort, undistortion
from gsedit.views.viewpoints import Viewpoint

UP = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)
RING = circle(0 * UP, 3.0, UP, 4, 32, elevation=20.0, fov=45.0)


def row(number: int, x: float, stands_on: int = -1) -> Segment:
    low, high, grey = (x, 0.0, 0.0), (x + 1, 1.0, 1.0), (0.5, 0.5, 0.5)
    return Segment(number, "object", 0.2, low, high, grey, ((grey, 1.0),), stands_on)


def two(apart: float, stands_on: int = -1) -> Segments:
    """Two alike objects, the second beside the first or on it."""
    return Segments(torch.arange(10) // 5, (row(0, 0.0), row(1, apart, stands_on)), 0)


class Search:
    """A search that counts how often it is made."""

    def __init__(self, found):
        self.found, self.times = found, 0

    def __call__(self):
        self.times += 1
        return self.found


@pytest.fixture
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "gsedit" / "looks"


def test_what_was_found_in_a_large_scene_is_not_searched_again(cache):
    scene = cloud(torch.rand(LEAST, 3, generator=torch.Generator().manual_seed(0)))
    inside = torch.arange(LEAST) % 7 < 3
    region, segments = Search(Region(inside, "as said", sure=0.75)), Search(two(4.0))
    segments.found = replace(segments.found, labels=torch.arange(LEAST) % 2)
    for _ in range(2):
        found = remembered("subject", scene, RING, region)
        assert torch.equal(found.inside, inside)
        assert (found.note, found.sure) == ("as said", 0.75)
        again = remembered("segments", scene, RING, segments)
        assert list(map(asdict, again.rows)) == list(map(asdict, segments.found.rows))
        assert torch.equal(again.labels, segments.found.labels)
    assert (region.times, segments.times) == (1, 1)
    remembered("subject with base", scene, RING, region)
    remembered("subject", scene, RING[:3], region)
    remembered("subject", replace(scene, sh=scene.sh + 1e-3), RING, region)
    assert region.times == 4
    for file in cache.glob("*.gz"):
        file.write_bytes(file.read_bytes()[:50])
    assert torch.equal(remembered("subject", scene, RING, region).inside, inside)
    assert region.times == 5


def test_small_scenes_leave_no_files(cache):
    search = Search(Region(torch.ones(9, dtype=torch.bool)))
    for _ in range(2):
        remembered("subject", cloud(torch.eye(9)[:, :3]), RING, search)
    assert search.times == 2
    assert not cache.exists()


def test_a_noun_that_may_be_any_of_several_objects_is_refused_with_their_numbers():
    everything = Region(torch.ones(10, dtype=torch.bool))
    with pytest.raises(SeveralObjects, match=r"'object 0' .* or .*object|'object 1'") as refused:
        check_alone("the clock", two(4.0), everything)
    assert refused.value.segments.rows[1].number == 1
    check_alone("the clock", two(1.01), everything)  # they touch
    check_alone("the clock", two(4.0, stands_on=0), everything)
    check_alone("the clock", two(4.0), Region(torch.arange(10) < 5))


def test_a_mask_drawn_on_a_photo_is_undistorted_as_the_photo_is(tmp_path):
    lens = Lens(40.0, 40.0, 16.0, 16.0, 32, 32).bent(k1=0.2)
    levels = np.zeros((64, 64), np.uint8)
    levels[10:50, 5:30] = 255
    view = Viewpoint("images/a.jpg", RING[0], lens)
    for name in ("a.png", "000_a.png"):
        Image.fromarray(levels).save(tmp_path / name)
    drawn = torch.from_numpy(levels).float()[..., None] / 255
    expected = undistort(drawn, undistortion(lens.scaled(64, 64)))[..., 0]
    expected = expected.reshape(32, 2, 32, 2).mean((1, 3))
    photo, render = (read_masks(tmp_path / name, [view])[0] for name in ("a.png", "000_a.png"))
    assert (photo - expected).abs().max() < 1e-5
    assert (render - photo).abs().max() > 0.3
    without = read_masks(tmp_path / "a.png", [replace(view, lens=None)])[0]
    assert torch.equal(without, render)
