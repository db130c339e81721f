"""Previews draw the attribute that was asked for, cameras, ellipsoids, two scenes."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from command_line import gsedit, one_line
from point_clouds import ball, cloud

from gsedit.errors import GseditError, UsageError
from gsedit.formats.scenes import save
from gsedit.pictures.viewer import drawing
from gsedit.pictures.viewer.drawing import Look, Panel, Surroundings
from gsedit.select.region import TINT
from gsedit.views.viewpoints import Viewpoint
from rasterizer import Camera, concatenate, look_at


def ahead(width: int = 64, height: int = 48) -> Camera:
    """At the origin, looking along +z."""
    pose = torch.eye(4, dtype=torch.float64)
    return Camera(pose, 60.0, 60.0, width / 2, height / 2, width, height)


def drawn(panels, camera, look=None, around=drawing.NO_SURROUNDINGS) -> np.ndarray:
    try:
        picture = drawing.draw(panels, camera, look or Look(), around)
    except UsageError:
        raise
    except GseditError as error:
        pytest.skip(f"no OpenGL here: {error}")
    return np.asarray(picture).astype(int)


def three(depths=(2.0, 4.0, 8.0)):
    """Three Gaussians in a row on the picture, at three depths."""
    return cloud(torch.tensor([[-0.3 * z, 0.0, z] for z in depths]) * torch.tensor([1.0, 1, 1]))


def test_attributes_are_what_their_names_say():
    scene = three()
    assert np.allclose(drawing.attribute(scene, "depth", ahead()).values, [2, 4, 8])
    assert np.allclose(drawing.attribute(scene, "size", ahead()).values, 0.05)
    assert np.allclose(drawing.attribute(scene, "anisotropy", ahead()).values, 1)
    assert np.allclose(drawing.attribute(scene, "scale_1", ahead()).values, np.log(0.05))
    extra = {"label": np.array([3, 4, 5], dtype=np.uint8)}
    assert list(drawing.attribute(scene, "label", ahead(), extra).values) == [3, 4, 5]
    behind = cloud(torch.tensor([[0.0, 0, -1], [0, 0, 1]]))
    assert np.isnan(drawing.attribute(behind, "depth", ahead()).values).tolist() == [True, False]


def test_points_are_colored_by_the_attribute():
    panels = [Panel(three((2.0, 4.0, 4.1)))]
    picture = drawn(panels, ahead(), Look("depth", "gray", point_size=5.0))
    row = picture[20:28]  # the color bar is further down
    grey = row[(row.max(-1) - row.min(-1) < 8) & (row.max(-1) < 250)]
    assert grey.min() < 40  # the nearest is at the dark end


def test_a_selection_is_tinted_and_the_rest_keeps_its_color():
    scene = concatenate(cloud(torch.tensor([[-0.8, 0.0, 2.0]]), color=(0.0, 1.0, 0.0)), three())
    flags = torch.tensor([False, True, False, False])
    colors = drawing.panel_colors(Panel(scene, selection=flags), Look("selection")) / 255
    assert np.allclose(colors[0], (0, 1, 0))
    assert np.abs(colors[1] - np.array(TINT)).max() < 0.46
    assert np.allclose(colors[2], (1, 0, 0))


def test_two_scenes_stand_side_by_side_from_one_camera():
    red = cloud(torch.tensor([[0.2, 0.1, 2.0]]))
    blue = cloud(torch.tensor([[0.2, 0.1, 2.0]]), color=(0.0, 0.0, 1.0))
    picture = drawn([Panel(red), Panel(blue)], ahead(), Look(point_size=5.0))
    assert picture.shape == (48, 128, 3)
    y, x = np.nonzero(picture[..., 0] - picture[..., 2] > 128)
    y2, x2 = np.nonzero(picture[..., 2] - picture[..., 0] > 128)
    assert x.max() < 64 <= x2.min()
    assert abs(x2.mean() - 64 - x.mean()) < 1
    assert abs(y.mean() - y2.mean()) < 1


def test_ellipsoids_have_the_gaussians_size_and_direction():
    scene = cloud(torch.tensor([[1.0, 2.0, 3.0]]))
    # long axis: x of the Gaussian, turned by 90 degrees around z, is y of the world
    quats = torch.tensor([[0.5**0.5, 0, 0, 0.5**0.5]])
    log_scales = torch.tensor([[0.5, 0.1, 0.2]]).log()
    scene = type(scene)(scene.means, quats, log_scales, scene.logit_opacities, scene.sh)
    try:
        vertices, faces = drawing.ellipsoids(scene)
    except GseditError as error:
        pytest.skip(str(error))
    assert faces.max() == len(vertices) - 1
    extent = np.abs(vertices - np.array([1.0, 2.0, 3.0])).max(0)
    assert np.allclose(extent, 2 * np.array([0.1, 0.5, 0.2]), rtol=0.06)  # a coarse sphere


def test_cameras_are_where_they_are_and_all_in_the_picture():
    target, up = torch.zeros(3), torch.tensor([0.0, -1.0, 0.0])
    eyes = torch.tensor([[4.0, 0, 0], [0, 0, 4.0], [-4.0, 0, 0], [0.0, 0, -4.0]])
    ring = tuple(
        Viewpoint(str(i), look_at(eye, target, up, 40.0, 64, 48)) for i, eye in enumerate(eyes)
    )
    scene = ball()
    length = drawing.frustum_length(ring, scene)
    corners = drawing.frustum(ring[0].camera, length)
    assert np.allclose(corners[0], [4, 0, 0])
    assert np.allclose(corners[1:].mean(0), [4 - length, 0, 0])
    camera = drawing.outside_camera(scene, ring, (64, 48))
    xy, depth = camera.project(eyes.double())
    assert (depth > 0).all()
    assert ((xy > 0) & (xy < torch.tensor([64, 48]))).all()
    blue = drawn([Panel(scene)], camera, around=Surroundings(ring))
    assert (blue[..., 2] - blue[..., 0] > 100).sum() > 4


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--color-by", "opactiy"], "did you mean opacity?"),
        (["--color-by", "size", "--colormap", "viridian"], "'viridian' is no color map"),
        (["--color-by", "selection"], "give --selection FLAGS.npy"),
        (["--color-by", "size", "--selection", "flags.npy"], "does not show --selection"),
        (["--cameras"], "add --data DATASET"),
        (["--sparse"], "add --data DATASET"),
        (["--selection", "flags.npy"], "has flags of shape (3,)"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_requests_that_cannot_be_drawn_are_one_line(words, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(drawing, "check_drawing", lambda: None)
    save(ball(), "a.ply")
    np.save("flags.npy", np.ones(3, dtype=bool))
    result = gsedit("view", "a.ply", "-o", "a.png", *words)
    assert result.exit_code in (2, 3)
    assert message in result.stderr
    assert one_line(result.stderr)
    assert not (tmp_path / "a.png").exists()
