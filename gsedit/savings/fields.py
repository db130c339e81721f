"""What of a scene an edit does not move."""

from __future__ import annotations

from gsedit.savings.decision import Bound, Decision, LeftOut

GEOMETRY = 10
"""Numbers of a Gaussian's position, rotation and scales."""


def decide_geometry(appearance: bool, coefficients: int) -> Decision:
    """Of positions, rotations and scales, where the setting `geometry` says that they stay."""
    if not appearance:
        return Decision("geometry", False, "Needed: --geometry full moves it")
    held = GEOMETRY + 1 + 3 * coefficients
    return Decision(
        "geometry",
        True,
        "Positions, rotations and scales stay (--geometry appearance): the update computes no "
        "gradient of them",
        (LeftOut(GEOMETRY, held, "numbers a Gaussian"),),
        GEOMETRY / held,
        "what the optimiser holds",
    )


def decide_densification() -> Decision:
    """Of adding Gaussians, which the fit to photos does and no edit."""
    return Decision(
        "densification",
        True,
        "An edit keeps the Gaussians that there are, so that region.npy and later edits still fit "
        "them; --no-plan adds none either",
        saving=0.0,
        saves="what --no-plan does",
        bound=Bound(0.0, ""),
    )
