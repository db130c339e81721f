"""The learned editor: a small InstructPix2Pix, trained from scratch on a CPU.

examples/train_small made its weights. Each name is imported when it is first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from rasterizer.lazy import make_lazy

if TYPE_CHECKING:
    from gsedit.editors.small.denoiser import DEFAULTS, Small, load_small, save_small
    from gsedit.editors.small.editor import SmallEditor
    from gsedit.editors.small.network import Architecture, SmallNetwork
    from gsedit.editors.small.shipped import REINSTALL, WEIGHTS

__all__ = [
    "DEFAULTS",
    "REINSTALL",
    "WEIGHTS",
    "Architecture",
    "Small",
    "SmallEditor",
    "SmallNetwork",
    "load_small",
    "save_small",
]

# asking whether the weights are there loads no torch
make_lazy(
    __name__,
    {
        "denoiser": ("DEFAULTS", "Small", "load_small", "save_small"),
        "editor": ("SmallEditor",),
        "network": ("Architecture", "SmallNetwork"),
        "shipped": ("REINSTALL", "WEIGHTS"),
    },
)
