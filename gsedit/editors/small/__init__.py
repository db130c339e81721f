"""The learned editor: a small InstructPix2Pix that is trained from scratch, on a CPU.

train_small makes what it learns from; examples/train_small.py trains it.
"""

from gsedit.editors.small.denoiser import REINSTALL, WEIGHTS, Small, load_small, save_small
from gsedit.editors.small.network import Architecture, Network

__all__ = ["REINSTALL", "WEIGHTS", "Architecture", "Network", "Small", "load_small", "save_small"]
