"""`gsedit repair`: what no renderer can draw, mended."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gsedit.points.repair import Repair


def repair() -> Repair:
    """Mend Gaussians with NaN, Inf or a rotation of length 0, and remove what cannot be mended.

    gsedit repair broken.ply -o scene.ply

    Infinite opacities become 15 or -15 (logits), scales of zero the smallest float, lost rotations
    of round Gaussians the identity, lost view-dependent colours 0. Every change is counted. Valid
    rows stay as they are.
    """
    from gsedit.points.repair import Repair

    return Repair()
