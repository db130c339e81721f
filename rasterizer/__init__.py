"""A picture of 3D Gaussians and its gradient, on a CPU. Usable alone.

Each name is imported when it is first used: `import rasterizer.numerics` loads no torch.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from rasterizer.lazy import make_lazy
from rasterizer.waiting import wait_briefly

if TYPE_CHECKING:
    from rasterizer.camera import Camera, look_at
    from rasterizer.numerics import Execution, Numerics
    from rasterizer.rasterization import rasterization
    from rasterizer.render import Rendering, contributions, render
    from rasterizer.scene import Gaussians, concatenate

wait_briefly()  # torch, which reads the variable when it is loaded, is imported later
make_lazy(__name__)
