"""How much of what found views show did real cameras see? Withholds the cameras beside a scene.

    python -m research.measure_viewpoints bear.ply

A pixel counts whose surface a real camera saw, too: at the same depth within 5 %, from a direction
within 60 degrees, and not from more than twice as far (in pixels on the surface).
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from time import perf_counter

import torch

from gsedit.cameras.choose import find_views
from gsedit.cameras.orbit import orbit
from gsedit.datasets.cameras_json import cameras_file, read_cameras
from gsedit.datasets.viewpoints import same_size
from gsedit.formats.scenes import load
from rasterizer import Camera, Gaussians, render

SIZE = 64


@torch.no_grad()
def depth_of(scene: Gaussians, camera: Camera) -> torch.Tensor:
    depth = render(scene, camera, median_depth=True).median_depth
    assert depth is not None
    return depth.double()


def seen_share(
    scene: Gaussians, view: Camera, real: Sequence[tuple[Camera, torch.Tensor]]
) -> float:
    """The share of a view's pixels that show what one of the real cameras saw well."""
    depth = depth_of(scene, view)
    points = view.unproject(view.pixel_centers(), depth)[depth > 0]
    from_view = points - view.center
    seen = torch.zeros(len(points), dtype=torch.bool)
    for camera, theirs in real:
        xy, z = camera.project(points)
        x, y = xy.unbind(-1)
        inside = (z > 0) & (x >= 0) & (x < camera.width) & (y >= 0) & (y < camera.height)
        column = x.nan_to_num().clamp(0, camera.width - 1).long()
        row = y.nan_to_num().clamp(0, camera.height - 1).long()
        same = (theirs[row, column] - z).abs() <= 0.05 * z
        from_camera = points - camera.center
        near = z / camera.fx <= 2 * from_view.norm(dim=-1) / view.fx
        facing = torch.cosine_similarity(from_view, from_camera, dim=-1) >= 0.5
        seen |= inside & same & near & facing
    return float(seen.sum()) / depth.numel()


def main(path: str) -> None:
    scene, file = load(path), cameras_file(path)
    if file is None:
        sys.exit(f"{path} has no cameras.json beside it: fit it again")
    cameras = [viewpoint.camera for viewpoint in same_size(read_cameras(file), SIZE)]
    real = [(camera, depth_of(scene, camera)) for camera in cameras]
    start = perf_counter()
    found = find_views(scene, 24, SIZE)
    write, seconds = sys.stdout.write, perf_counter() - start
    write(f"{len(found)} views found in {seconds:.0f} s, {len(scene)} Gaussians\n")
    for name, views in (("found", found), ("orbit", orbit(scene, 24, SIZE))):
        shares = torch.tensor([seen_share(scene, view, real) for view in views])
        write(f"{name}: {float(shares.mean()):.3f} mean, {float(shares.min()):.3f} worst\n")


if __name__ == "__main__":
    main(sys.argv[1])
