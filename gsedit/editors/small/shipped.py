"""Paths of the weights that come with gsedit. Loads no torch."""

from __future__ import annotations

from pathlib import Path

WEIGHTS = Path(__file__).with_name("small.safetensors")
REINSTALL = "they come with gsedit: install it again, or check the file out again in a clone"
