"""Selections that a person makes on the page: by clicks, boxes and words; larger and smaller."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool
from torch import Tensor

from gsedit.errors import UsageError
from gsedit.scene.table import table_of
from gsedit.select.click import SMALLEST, Click, Selector, at_one_place
from gsedit.select.region import Region
from gsedit.select.rules import given, grow, shrink
from rasterizer.scene import Gaussians

BRIM = 0.01
"""Share of the radius of the scene's bulk by which Grow and Shrink move the border."""


@dataclass(frozen=True)
class Clicks:
    """The clicks of one selection, in order, and what was selected before them."""

    clicks: tuple[Click, ...] = ()

    def with_click(self, click: Click, *, add: bool) -> Clicks:
        """With one more click; a plain one begins anew, but at the same place takes the part there.
        Raises UsageError for a first one outside."""
        if not add:
            again = self.clicks and all(at_one_place(click, each) for each in self.clicks)
            return replace(self, clicks=(*self.clicks, click)) if again else Clicks((click,))
        if not self.clicks and not click.inside:
            raise UsageError("click on the object first; then take parts away")
        return replace(self, clicks=(*self.clicks, click))

    def selected(self, selector: Selector) -> tuple[Clicks, Region]:
        """The region of the clicks; where there is no smaller part, the whole object again, as with
        the last click alone. Raises UsageError as `Selector.at` does."""
        region = selector.at(self.clicks)
        if not region.note.endswith(SMALLEST):
            return self, region
        whole = Clicks(self.clicks[-1:])
        return whole, selector.at(whole.clicks)


def grown(scene: Gaussians, flags: Bool[Tensor, " n"], radius: float) -> Bool[Tensor, " n"]:
    """The selection and all within a radius of it, world units; shrunk by a negative one."""
    inside = given(flags.numpy())
    selection = grow(inside, radius) if radius > 0 else shrink(inside, -radius)
    return torch.from_numpy(selection.mask(table_of(scene)))
