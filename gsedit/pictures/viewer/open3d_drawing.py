"""Pictures by Open3D: splats through software Vulkan where that is, else points without any GL.

Open3D 0.20 draws splats with SH up to degree 2 and rotations of 8 bits: a look, and an independent
check, not a measure. It runs in a process of its own: drivers write to stdout, or end the process.
"""

from __future__ import annotations

import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import torch
from jaxtyping import Bool, Float
from PIL import Image
from torch import Tensor

from gsedit.formats.pictures import save_picture
from gsedit.pictures.viewer.libraries import check_screen, import_open3d
from gsedit.pictures.viewer.point_clouds import open3d_cloud, solid, splat_colors, to_open3d
from gsedit.scene.framing import framing_camera
from rasterizer.camera import Camera
from rasterizer.scene import Gaussians

BESIDE = 2.0
"""Half pictures from the middle. Open3D does not bound its linear projection: a splat beside the
camera would cover the picture, so those farther out are not given to it."""
NO_VULKAN = (
    "Open3D finds no Vulkan to draw splats with, so its points are shown; on Debian: "
    "apt-get install -y libvulkan1 mesa-vulkan-drivers"
)
WHOLE_PICTURES = 25
"""Mesa of this version draws all 16x16 tiles; 22.3 (Debian 12) loses some."""
_CHILD = """
import os, sys
os.environ.setdefault("LP_NUM_THREADS", "0")  # with threads, pictures differ from run to run
import numpy as np, open3d
folder = sys.argv[1]
data = dict(np.load(folder + "/scene.npz"))
width, height = (int(each) for each in data.pop("size"))
intrinsics, pose = data.pop("intrinsics"), data.pop("pose")
cloud = open3d.t.geometry.PointCloud()
for name, values in data.items():
    cloud.point[name] = open3d.core.Tensor(values)
rendering = open3d.visualization.rendering
renderer = rendering.OffscreenRenderer(width, height)
material = rendering.MaterialRecord()
material.shader = "gaussianSplat"
material.gaussian_splat_max_tiles_per_splat = 4096  # larger ones are left out
renderer.scene.set_background([1, 1, 1, 1])
renderer.scene.add_geometry("scene", cloud, material)
renderer.setup_camera(intrinsics, pose, width, height)
open3d.io.write_image(folder + "/picture.png", renderer.render_to_image())
"""


def preview_open3d(
    scene: Gaussians,
    path: Path | str | None = None,
    *,
    camera: Camera | None = None,
    size: tuple[int, int] = (960, 720),
    min_opacity: float = 0.1,
    overwrite: bool = False,
) -> str:
    """Let Open3D draw the scene: into a PNG at `path`, or as points in a window without one. What a
    person should know of the picture.

    `min_opacity` leaves out points, not splats. Raises UsageError where it leaves none, or there is
    no screen for a window; GseditError where open3d is missing.
    """
    import_open3d()
    camera = camera or framing_camera(scene, size=size)
    if path is None:
        check_screen()
        show_points(scene[solid(scene, min_opacity)], camera)
        return ""
    picture, note = draw_splats(scene, camera) or (
        draw_points(scene[solid(scene, min_opacity)], camera),
        NO_VULKAN,
    )
    save_picture(picture, path, overwrite=overwrite)
    return note


def draw_splats(
    scene: Gaussians, camera: Camera, program: str = _CHILD
) -> tuple[Image.Image, str] | None:
    """The splats over white, by software Vulkan, and what a person should know of the picture; None
    where Open3D, in a process that runs `program`, does not get to one."""
    scene = scene[in_reach(scene, camera)].detach()
    scene = replace(scene, quats=torch.nn.functional.normalize(scene.quats, dim=1))
    intrinsics, pose = matrices(camera)
    with TemporaryDirectory() as folder:
        arrays = {name: tensor.numpy() for name, tensor in to_open3d(scene).point.items()}
        np.savez(
            Path(folder, "scene.npz"), intrinsics=intrinsics, pose=pose,
            size=[camera.width, camera.height], **arrays,
        )  # fmt: skip
        done = subprocess.run(
            [sys.executable, "-c", program, folder], capture_output=True, check=False
        )
        picture = Path(folder, "picture.png")
        if done.returncode or not picture.is_file():
            return None
        with Image.open(picture) as image:
            return image.convert("RGB"), driver_note(done.stdout + done.stderr)


def driver_note(log: bytes) -> str:
    """Known faults of the Mesa version that Filament's log names, for a person."""
    version = re.search(rb"Mesa (\d+)\.[\d.]+", log)
    if version is None or int(version[1]) >= WHOLE_PICTURES:
        return ""
    return (
        f"{version[0].decode()} can leave square holes of 16 pixels in the picture: newer ones, of "
        f"{WHOLE_PICTURES}.0 and later, do not"
    )


def draw_points(scene: Gaussians, camera: Camera) -> Image.Image:
    """The centers as squares over white, by Open3D's z-buffer on the CPU: needs no GL."""
    open3d = import_open3d()
    # a point fills one pixel: of a smaller picture, which is then enlarged without blur
    share = (camera.width * camera.height / max(len(scene), 1)) ** 0.5
    zoom = round(min(max(share, 3.0), 8.0))
    small = camera.resized(max(1, camera.width // zoom), max(1, camera.height // zoom))
    cloud = open3d_cloud(open3d, {"positions": scene.means, "colors": splat_colors(scene)})
    # its z-buffer rounds: the middle of a pixel is at whole numbers, ours at halves
    small = replace(small, cx=small.cx - 0.5, cy=small.cy - 0.5)
    intrinsics, pose = (open3d.core.Tensor(matrix) for matrix in matrices(small))
    drawn = cloud.project_to_rgbd_image(
        small.width, small.height, intrinsics, pose, depth_scale=1.0, depth_max=float("inf")
    )
    depth = np.asarray(drawn.depth.to_legacy())
    colors = np.where(depth[..., None] > 0, np.asarray(drawn.color.to_legacy()), 1.0)
    picture = Image.fromarray((colors.clip(0, 1) * 255).round().astype(np.uint8))
    return picture.resize((camera.width, camera.height), Image.Resampling.NEAREST)


def show_points(scene: Gaussians, camera: Camera) -> None:
    """Open a window of Open3D with the centers, until it is closed.

    Not with splats: what `in_reach` leaves out changes with every movement.
    """
    open3d = import_open3d()
    cloud = open3d.geometry.PointCloud(
        open3d.utility.Vector3dVector(scene.means.detach().double().numpy())
    )
    cloud.colors = open3d.utility.Vector3dVector(splat_colors(scene).double().numpy())
    target = camera.center + camera.forward * (scene.means.double().mean(0) - camera.center).norm()
    open3d.visualization.draw_geometries(
        [cloud], window_name="gsedit", width=camera.width, height=camera.height, zoom=0.5,
        lookat=target.numpy(), front=-camera.forward.numpy(), up=-camera.rotation[1].numpy(),
    )  # fmt: skip


def in_reach(scene: Gaussians, camera: Camera) -> Bool[Tensor, " n"]:
    """Flag Gaussians that lie in front of the camera and not far beside its picture (BESIDE)."""
    xy, depth = camera.project(scene.means.detach().double())
    half = torch.tensor([camera.width, camera.height], dtype=torch.float64) / 2
    return (depth > 0) & (((xy - half).abs() / half).amax(1) < BESIDE)


def matrices(camera: Camera) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "4 4"]]:
    """Intrinsics and world-to-camera pose, float64: Open3D's convention is that of our cameras."""
    intrinsics = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1.0]])
    return intrinsics, camera.world_to_camera.detach().double().numpy()
