"""Views are found by name, by the end of a name, or by number."""

from dataclasses import replace

import pytest
from small_scenes import globe

from gsedit.bench.synthetic.splats import ring_cameras
from gsedit.errors import UsageError
from gsedit.views.viewpoints import Viewpoint, same_size, view_named

NAMES = ("images/frame_1.jpg", "images/frame_2.jpg", "left/0.png", "right/0.png")


@pytest.fixture(scope="module")
def views():
    cameras = ring_cameras(globe(), len(NAMES), 32)
    return [Viewpoint(name, camera) for name, camera in zip(NAMES, cameras)]


@pytest.mark.parametrize("said", ["images/frame_2.jpg", "frame_2.jpg", "frame_2", "1"])
def test_a_view_has_several_names(views, said):
    assert view_named(views, said).name == NAMES[1]


@pytest.mark.parametrize(
    ("said", "told"),
    [("frame_3.jpg", "did you mean"), ("0.png", "several"), ("²", "first is"), ("9", "first is")],
)
def test_a_name_of_none_or_several_is_refused(views, said, told):
    with pytest.raises(UsageError, match=told):
        view_named(views, said)


def test_pictures_of_one_size_show_what_their_photos_show():
    """The principal point stays; only pictures of other proportions are centered."""
    first, second = ring_cameras(globe(), 2, 64)
    shifted = replace(first, cx=30.0, cy=35.0)
    wide = replace(second.resized(96, 64), cx=40.0)
    views = same_size([Viewpoint(n, c) for n, c in zip("abc", (shifted, shifted, wide))], 32)
    kept, _, centered = (view.camera for view in views)
    assert (kept.cx, kept.cy, kept.width) == (15.0, 17.5, 32)
    assert (centered.cx, centered.cy, centered.width, centered.height) == (16.0, 16.0, 32, 32)
