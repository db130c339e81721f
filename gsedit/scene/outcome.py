"""The outcome of an operation that adds, drops or moves Gaussians.

`n` Gaussians before, `m` after.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Int
from torch import Tensor

from gsedit.errors import UsageError
from rasterizer.scene import Gaussians

NEW = -1
"""Row of a Gaussian that was not in the scene before."""


@dataclass(frozen=True, eq=False)
class Outcome:
    """A scene after an operation, and where each of its Gaussians comes from."""

    scene: Gaussians
    """The scene after it: `m` Gaussians."""
    origin: Int[Tensor, " m"]
    """Row in the scene before; NEW for a Gaussian that was not in it."""
    changed: Bool[Tensor, " m"]
    """Whether values may differ from that row's; always for new ones. The others keep their bits.
    """
    notes: tuple[str, ...] = ()
    """Remarks for a person on what was done and what could not be known."""

    def dropped(self, count: int) -> Bool[Tensor, " n"]:
        """Whether each of the `count` Gaussians before is in the scene no longer."""
        kept = torch.zeros(count, dtype=torch.bool)
        kept[self.origin[self.origin != NEW]] = True
        return ~kept

    def then(self, after: Outcome) -> Outcome:
        """This operation and one on its scene, as one."""
        old = after.origin != NEW
        rows = after.origin.clamp_min(0)
        origin = torch.where(old, self.origin[rows], NEW)
        changed = after.changed | self.changed[rows]
        return Outcome(after.scene, origin, changed, (*self.notes, *after.notes))


def same(scene: Gaussians) -> Outcome:
    """The outcome of doing nothing."""
    return Outcome(scene, torch.arange(len(scene)), torch.zeros(len(scene), dtype=torch.bool))


def check_finite(scene: Gaussians) -> None:
    """Raise UsageError for values that nothing can be done with: the first row of them."""
    for name in ("means", "quats", "log_scales", "logit_opacities", "sh"):
        values = getattr(scene, name)[..., None].flatten(1)
        # points, and opacities 0 and 1, are infinite
        fine = ~values.isnan() if name in ("log_scales", "logit_opacities") else values.isfinite()
        if not fine.all():
            row = int((~fine.all(1)).nonzero()[0])
            raise UsageError(f"{name} of Gaussian {row} are not finite: run 'gsedit clean' first")
