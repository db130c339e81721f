"""The learned editor: a small InstructPix2Pix, its training is in the model card."""

from __future__ import annotations

from pathlib import Path

WEIGHTS = Path(__file__).with_name("small.safetensors")
REINSTALL = "they come with gsedit: install it again, or check the file out again in a clone"
