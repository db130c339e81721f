"""Folder of real captures, beside the checkout; tests that need one skip where it is absent."""

from __future__ import annotations

from pathlib import Path

DATA = Path(__file__).parents[2] / "shared" / "data"
