"""Pictures by Open3D: splats through software Vulkan.

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
from PIL import Image

from gsedit.errors import GseditError
from gsedit.pictures.viewer.point_clouds import to_open3d
from rasterizer.camera import Camera
from rasterizer.scene import Gaussians

BESIDE = 0.5
"""Share of the picture's sides. Open3D does not bound its linear projection: a splat beside the
camera would cover the picture, so those farther out than that are not given to it."""
NO_VULKAN = (
    "Open3D finds no Vulkan to draw splats with: leave out --open3d to see points; on Debian: "
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


def draw_splats(scene: Gaussians, camera: Camera, program: str = _CHILD) -> tuple[Image.Image, str]:
    """The splats over white, by software Vulkan, and what a person should know of the picture.

    Raises GseditError where open3d is missing, and where Open3D, in a process that runs `program`,
    does not get to a picture.
    """
    _, _, near = camera.pictured(scene.means.detach().double(), -BESIDE)
    scene = scene[near].detach()
    scene = replace(scene, quats=torch.nn.functional.normalize(scene.quats, dim=1))
    # Open3D's convention is that of our cameras
    intrinsics = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1.0]])
    pose = camera.world_to_camera.detach().double().numpy()
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
            raise GseditError(NO_VULKAN)
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
