"""A picture of 3D Gaussians and its gradient, on a CPU. Usable alone."""

from rasterizer.camera import Camera, look_at
from rasterizer.numerics import Execution, Numerics
from rasterizer.rasterization import rasterization
from rasterizer.render import Rendering, contributions, render
from rasterizer.scene import Gaussians, concatenate

__all__ = [
    "Camera",
    "Execution",
    "Gaussians",
    "Numerics",
    "Rendering",
    "concatenate",
    "contributions",
    "look_at",
    "rasterization",
    "render",
]
