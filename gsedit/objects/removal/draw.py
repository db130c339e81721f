"""Texture that another program makes up, instead of copies. `h w` pixels."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.errors import UsageError
from gsedit.objects.removal.membrane import solve_membrane

Draw = Callable[[Float[Tensor, "h w 3"], Bool[Tensor, "h w"]], Float[Tensor, "h w 3"]]
"""Paints what a mask flags in a picture, sRGB in [0, 1], and returns the picture."""


def drawn_over(
    picture: Float[np.ndarray, "h w 3"],
    known: Bool[np.ndarray, "h w"],
    hole: Bool[np.ndarray, "h w"],
    draw: Draw,
) -> Float[np.ndarray, "h w 3"]:
    """The picture with its hole drawn by another, its light evened at the border.

    Raises UsageError for a picture of another size, or values that are not finite.
    """
    given = torch.from_numpy(np.where((hole | known)[..., None], picture, 0)).clamp(0, 1).float()
    drawn = draw(given, torch.from_numpy(hole)).detach().double().numpy()
    if drawn.shape != picture.shape or not np.isfinite(drawn).all():
        raise UsageError(
            f"what draws returned {drawn.shape}: return the picture's {picture.shape}, finite"
        )
    rest = solve_membrane(np.where(hole[..., None], 0.0, picture - drawn), hole, known)
    return np.where(hole[..., None], drawn + rest, picture)
