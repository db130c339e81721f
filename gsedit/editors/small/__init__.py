"""The learned editor: a small InstructPix2Pix, trained from scratch on a CPU.

examples/train_small made its weights.
"""

from gsedit.editors.small.denoiser import (
    DEFAULTS,
    REINSTALL,
    WEIGHTS,
    Small,
    load_small,
    save_small,
)
from gsedit.editors.small.network import Architecture, SmallNetwork

__all__ = [
    "DEFAULTS",
    "REINSTALL",
    "WEIGHTS",
    "Architecture",
    "Small",
    "SmallNetwork",
    "load_small",
    "save_small",
]
