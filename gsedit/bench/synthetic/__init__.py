"""Small scenes with exact pictures, depth, correspondences and edited ground truth."""

from gsedit.bench.synthetic.gallery import demo_scene
from gsedit.bench.synthetic.scene import SyntheticScene, Traced, first_hit
from gsedit.bench.synthetic.splats import ring_cameras, surface_gaussians, surface_points

__all__ = [
    "SyntheticScene",
    "Traced",
    "demo_scene",
    "first_hit",
    "ring_cameras",
    "surface_gaussians",
    "surface_points",
]
