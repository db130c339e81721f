"""A gsplat script on a laptop: one import differs. Renders a turn around a scene to a folder.

python examples/from_gsplat.py out/turn [scene.ply]
"""

from __future__ import annotations

import sys
from pathlib import Path

import torch
from PIL import Image

import gsedit
from gsedit.bench.synthetic import demo_scene, surface_gaussians
from gsedit.views.orbit import orbit

# from gsplat import rasterization
from rasterizer import rasterization


def turn(folder: Path, path: str | None = None, count: int = 12, size: int = 256) -> None:
    """Write color beside depth, as brightness, of `count` views; no path: the built-in bear."""
    if path is not None:
        scene = gsedit.load(path)
    else:
        scene = surface_gaussians(demo_scene(), 10_000, torch.Generator().manual_seed(0))
    cameras = orbit(scene, count, size)
    viewmats = torch.stack([c.world_to_camera for c in cameras]).float()
    Ks = torch.tensor([[[c.fx, 0, c.cx], [0, c.fy, c.cy], [0, 0, 1]] for c in cameras])
    with torch.no_grad():
        colors, alphas, meta = rasterization(
            means=scene.means,
            quats=scene.quats,
            scales=torch.exp(scene.log_scales),
            opacities=torch.sigmoid(scene.logit_opacities),
            colors=scene.sh,
            viewmats=viewmats,
            Ks=Ks,
            width=size,
            height=size,
            sh_degree=scene.degree,
            render_mode="RGB+ED",
            backgrounds=torch.ones(count, 3),
            packed=False,
        )
    folder.mkdir(parents=True, exist_ok=True)
    for i, picture in enumerate(colors):
        depth = picture[..., 3:].where(alphas[i] > 0.5, torch.inf)
        sheet = torch.cat((picture[..., :3], (depth.min() / depth).expand(-1, -1, 3)), 1)
        pixels = sheet.clamp(0, 1).mul(255).round().byte().numpy()
        Image.fromarray(pixels).save(folder / f"{i:03d}.png")
    sys.stdout.write(f"{count} views in {folder}, tiles of {meta['tile_size']} pixels\n")


if __name__ == "__main__":
    if len(sys.argv) not in (2, 3):
        sys.exit(__doc__)
    turn(Path(sys.argv[1]), sys.argv[2] if len(sys.argv) == 3 else None)
