"""Views: cameras, posed pictures, and what cameras see of surfaces."""

from typing import Literal

PathKind = Literal["turntable", "orbit", "spline"]
"""Kinds of camera paths, see `gsedit.views.paths`."""
