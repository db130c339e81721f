"""Lists of views: what is written is read to the last bit, and what is wrong is named."""

import json
from dataclasses import replace

import pytest
import torch

from gsedit import View
from gsedit.errors import InputError, UsageError
from gsedit.views.view_list_files import (
    ViewList,
    by_capture,
    by_edit,
    read_view_list,
    with_roles_of,
    write_view_list,
)
from gsedit.views.view_pictures import read_view_pictures, write_view_pictures
from gsedit.views.viewpoints import Viewpoint
from rasterizer import look_at

FRAME = {
    "file_path": "a.jpg", "w": 8, "h": 6, "fl_x": 9.5, "fl_y": 9.0, "cx": 4.25, "cy": 3.0,
    "transform_matrix": [[1.0, 0, 0, 1], [0, 1.0, 0, 2], [0, 0, 1.0, 3], [0, 0, 0, 1.0]],
}  # fmt: skip


def viewpoints(count=10):
    up = torch.tensor([0.1, 0.2, 1.0])
    eyes = torch.tensor([[2.0, 1.0, 0.3 * i] for i in range(count)])
    cameras = [replace(look_at(eye, torch.zeros(3), up, 50.0, 12, 10), near=0.3) for eye in eyes]
    return tuple(Viewpoint(f"images/{i:02d}.jpg", camera) for i, camera in enumerate(cameras))


def test_a_list_is_read_as_it_was_written(tmp_path):
    views = by_edit(viewpoints(), {"images/03.jpg", "images/05.jpg"})
    write_view_list(views, tmp_path / "views.json")
    found = read_view_list(tmp_path / "views.json")
    assert found.roles == views.roles
    assert found.having("edited") == (3, 5)
    assert found.having("held_out") == (0, 8)
    for a, b in zip(found.viewpoints, views.viewpoints):
        assert a.name == b.name
        assert a.camera.world_to_camera.allclose(
            b.camera.world_to_camera.double(), rtol=0, atol=1e-12
        )
        for key in ("fx", "fy", "cx", "cy", "width", "height", "near"):
            assert getattr(a.camera, key) == getattr(b.camera, key)
    with pytest.raises(UsageError, match="already exists"):
        write_view_list(views, tmp_path / "views.json")


def test_the_keys_are_nerfstudios(tmp_path):
    path = tmp_path / "views.json"
    shared = {key: FRAME[key] for key in ("w", "h", "fl_x", "fl_y", "cx", "cy")}
    frame = {key: FRAME[key] for key in ("file_path", "transform_matrix")}
    path.write_text(json.dumps({**shared, "frames": [frame]}))
    views = read_view_list(path)
    camera = views.viewpoints[0].camera
    assert views.roles == ("held_out",)
    assert camera.center.tolist() == [1, 2, 3]
    assert camera.forward.tolist() == [0, 0, -1]  # OpenGL: a camera looks along its -z
    assert (camera.fx, camera.cx, camera.width) == (9.5, 4.25, 8)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"role": "best"}, r"frames\[0\]: role is 'best': give one of edited, held_out, other"),
        ({"fl_x": None}, r"frames\[0\] .*has no fl_x"),
        ({"fl_x": -1}, "not positive"),
        ({"k1": 0.1}, "lens has distortion"),
        ({"file_path": ""}, r"frames\[0\].file_path is '', not a text"),
        ({"transform_matrix": [[1, 2], [3, 4]]}, "is not 4x4 numbers"),
    ],
)
def test_what_is_wrong_is_named(tmp_path, change, message):
    path = tmp_path / "views.json"
    path.write_text(json.dumps({"frames": [{**FRAME, **change}]}))
    with pytest.raises(InputError, match=message):
        read_view_list(path)


def test_roles_of_another_list_go_by_name():
    views = by_capture(viewpoints())
    given = ViewList(views.viewpoints[4:6], ("held_out", "edited"))
    assert with_roles_of(given, views).roles[3:7] == ("other", "held_out", "edited", "other")
    strangers = ViewList((Viewpoint("z.jpg", views.viewpoints[0].camera),), ("edited",))
    with pytest.raises(UsageError, match=r"none of the listed views \(z.jpg"):
        with_roles_of(strangers, views)


# ---- pictures of views ---------------------------------------------------------------------------


def views(size=(10, 12)):
    generator = torch.Generator().manual_seed(0)
    return [
        View(each.name, each.camera, torch.rand(*size, 3, generator=generator))
        for each in viewpoints(3)
    ]


def test_pictures_of_views_are_found_by_their_names(tmp_path):
    write_view_pictures(tmp_path / "targets", views()[:2])
    found = read_view_pictures(tmp_path / "targets", viewpoints())
    assert sorted(found) == [0, 1]
    assert found[1].allclose(views()[1].image, atol=0.5 / 255 + 1e-6)
    write_view_pictures(tmp_path / "others", views()[2:])
    assert list(read_view_pictures(tmp_path / "others", viewpoints())) == [2]
    write_view_pictures(tmp_path / "all", views())
    some = viewpoints()[1:2]  # a list of fewer views than there are pictures
    assert list(read_view_pictures(tmp_path / "all", some)) == [0]
    (tmp_path / "others" / "images" / "02.png").rename(tmp_path / "others" / "002_02.png")
    assert list(read_view_pictures(tmp_path / "others", viewpoints())) == [2]
