"""Maps of a view: normals against a sphere's, and the two sides of a wipe."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from scenes import cloud, shell

from gsedit import render_maps
from gsedit.pictures import MAPS
from gsedit.pictures.maps import LEGEND, depth_picture, normal_map, wipe
from rasterizer import Camera, Gaussians, look_at, render


def front() -> Camera:
    """Discs on the shell with center (0, 0, 3) and radius 0.8, turned a little."""
    target = torch.tensor([0.0, 0.0, 3.0])
    return look_at(
        torch.tensor([0.7, -0.4, 0.0]), target, torch.tensor([0.1, -1.0, 0.0]), 40.0, 96, 96
    )


def sphere_normals(camera: Camera) -> tuple[torch.Tensor, torch.Tensor]:
    """Exact normals of the shell's sphere in the camera's axes, y up and z towards the viewer; and
    where it is seen, but at its rim."""
    center = camera.project(torch.tensor([[0.0, 0.0, 3.0]], dtype=torch.float64))
    xy, z = center
    rays = camera.pixel_centers() - torch.tensor([camera.cx, camera.cy], dtype=torch.float64)
    rays = torch.cat((rays / camera.fx, torch.ones(*rays.shape[:-1], 1)), -1)
    rays = rays / rays.norm(dim=-1, keepdim=True)
    middle = torch.stack(((xy[0, 0] - camera.cx) / camera.fx * z[0],
                          (xy[0, 1] - camera.cy) / camera.fy * z[0], z[0]))  # fmt: skip
    along = rays @ middle
    square = along**2 - (middle @ middle - 0.8**2)
    normals = ((along - square.clamp_min(0).sqrt())[..., None] * rays - middle) / 0.8
    normals = normals * torch.tensor([1.0, -1.0, -1.0], dtype=torch.float64)
    return normals, (square > 0) & (normals[..., 2] > 0.25)


def degrees_off(found: torch.Tensor, exact: torch.Tensor) -> torch.Tensor:
    return torch.rad2deg((found.double() * exact).sum(-1).clamp(-1, 1).acos())


def test_normals_of_a_sphere_of_discs_are_those_of_the_sphere():
    camera = front()
    exact, seen = sphere_normals(camera)
    errors = []
    for count in (400, 1600):
        normals = normal_map(shell(count)[0].to(torch.float32), camera)
        torch.testing.assert_close(normals[seen].norm(dim=-1), torch.ones(int(seen.sum())))
        off = degrees_off(normals, exact)[seen]
        errors.append(float(off.mean()))
        assert float(off.quantile(0.95)) < 2 * errors[-1]
        assert not normals[0, 0].any()
    assert errors[0] < 9
    assert errors[1] < 0.7 * errors[0]  # it falls with the spacing of the discs


def test_normals_do_not_depend_on_the_sign_or_order_of_axes():
    scene, camera = shell()[0].to(torch.float32), front()
    turned = replace(scene, quats=-scene.quats, log_scales=scene.log_scales)
    torch.testing.assert_close(normal_map(turned, camera), normal_map(scene, camera))


def test_balls_have_no_normals_and_do_not_spoil_those_of_discs():
    scene, camera = shell()[0].to(torch.float32), front()
    balls = replace(scene, log_scales=torch.full_like(scene.log_scales, -4.0))
    assert not normal_map(balls, camera).any()
    both = Gaussians(
        *(torch.cat((getattr(scene, name), getattr(balls, name)))
          for name in ("means", "quats", "log_scales", "logit_opacities", "sh"))
    )  # fmt: skip
    exact, seen = sphere_normals(camera)
    assert float(degrees_off(normal_map(both, camera), exact)[seen].mean()) < 9


def test_maps_are_those_that_are_wanted():
    scene, camera = cloud()
    plain = render_maps(scene, camera)
    assert plain.depth is None
    assert plain.normals is None
    maps = render_maps(scene, camera, MAPS)
    drawn = render(scene, camera, median_depth=True)
    torch.testing.assert_close(maps.color, drawn.color)
    torch.testing.assert_close(maps.depth, drawn.median_depth)
    torch.testing.assert_close(maps.alpha, drawn.alpha)


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_a_wipe_is_one_scene_on_the_left_and_the_other_on_the_right(share):
    scene, camera = cloud()
    other = replace(scene, sh=-scene.sh)
    before, after = (render(each, camera).color for each in (scene, other))
    edge = round(share * camera.width)
    picture = wipe(scene, other, camera, share)
    assert picture.shape == before.shape
    left, right = slice(0, max(0, edge - 2)), slice(edge + 2 if edge else 0, None)
    torch.testing.assert_close(picture[:, left], before[:, left], atol=1e-9, rtol=0)
    torch.testing.assert_close(picture[:, right], after[:, right], atol=1e-9, rtol=0)
    if 0 < share < 1:
        assert (picture[:, edge] == 1).all()


def test_depth_picture_is_red_near_blue_far_black_where_nothing_is():
    depth = torch.linspace(1, 3, 64)[None].repeat(8, 1)
    alpha = torch.ones_like(depth)
    alpha[:2] = 0
    picture = np.asarray(depth_picture(depth, alpha)).astype(int)
    assert picture.shape == (8 + LEGEND, 64, 3)
    assert (picture[:2] == 0).all()
    near, far = picture[5, 2], picture[5, -3]
    assert near[0] > near[2]  # red
    assert far[2] > far[0]  # blue
