"""Remains of an object: its rim, floaters in it, Gaussians under it that nobody saw.

`n` Gaussians of the scene without the object's own.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from gsedit.objects.removal.sight import Contributions
from gsedit.objects.removal.walls import Plane
from gsedit.scene.neighbors import k_nearest

SHOWN = 1e-3
"""Pixels that a Gaussian contributes at least to all views, for them to say something of it."""
UNSEEN = 0.15
"""Share of what a Gaussian now contributes, up to which nobody saw it behind the object."""
UNSURE, SURE = 0.5, 0.6
"""Such shares up to which it was seen too little to be believed, and from which it is."""
RIM = 0.06
"""Farthest that the object's rim reaches, of its extent."""
TOUCHED = 0.03
"""Farthest that remains of the object's foot reach on a plane, of its extent."""
AROUND = 0.4
"""Farthest that a Gaussian is believed to look like what was hidden, of the extent."""
OUTLINED = 0.9
"""Share of what it contributes that is in the object's outlines, from which it is enclosed."""
FAINT, HAZE, HAZE_OUTLINED = 0.3, 0.15, 0.6
"""Opacity of haze, its farthest reach, of the extent, and its least share in the outlines."""
ALIKE, ALIKE_SHARE, LEAST_SURE = 0.06, 0.01, 50
"""Distance of two colors that are alike, the share of the sure ones that must be alike, and the
least number of them that says something."""


def strays(
    points: Float[np.ndarray, "n 3"],
    colors: Float[np.ndarray, "n 3"],
    opacities: Float[np.ndarray, " n"],
    away: Float[np.ndarray, " n"],
    seen: Float[np.ndarray, " n"],
    now: Contributions,
    planes: Sequence[Plane],
) -> Bool[np.ndarray, " n"]:
    """Flag the Gaussians that go with the object.

    `away` is the distance from the object in its extent, `seen` what each Gaussian contributed
    while the object was there, `now` what it does without. Those go that nobody saw, on a
    plane or near the object; near it, what is enclosed and on no plane; haze
    that is seen before the object more than beside it; and on a plane, what was
    hardly seen, or touches the object, and does not look like it: remains of a foot or a shadow.
    """
    total = np.maximum(now.total.numpy(), SHOWN)
    trust = np.where(now.total.numpy() < SHOWN, 1.0, seen / total)
    enclosed = now.outlined.numpy() > OUTLINED * total
    layers = [plane.on(points) for plane in planes]
    flat = np.any(layers, 0) if layers else np.zeros(len(points), bool)
    close = away < RIM
    gone = (trust < UNSEEN) & (flat | close) | (enclosed & close & ~flat)
    haze = (opacities < FAINT) & (away < HAZE) & ~flat
    gone |= haze & (now.outlined.numpy() > HAZE_OUTLINED * total) & (trust < SURE)
    for layer in layers:
        touched = away < TOUCHED
        sure = np.flatnonzero(layer & (away < AROUND) & ~touched & (trust > SURE))
        asked = np.flatnonzero(layer & ((trust < UNSURE) | touched) & ~gone)
        if len(sure) >= LEAST_SURE and len(asked):
            k = max(1, int(ALIKE_SHARE * len(sure)))
            gone[asked[k_nearest(colors[sure], colors[asked], k)[0][:, -1] > ALIKE]] = True
    return gone
