"""Selections that a person makes on the page: by clicks, boxes and words; larger and smaller."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool
from torch import Tensor

from gsedit.editing.routes.finder import Finder
from gsedit.errors import UsageError
from gsedit.regions.region import Region
from gsedit.scene.shapes import Bool as Flags
from gsedit.scene.table import SplatTable, table_of
from gsedit.selecting.click import Click, Selector
from gsedit.toolkit.selection.base import WholeSelection
from gsedit.toolkit.selection.near_selected import Grown, Shrunk
from rasterizer.scene import Gaussians

BRIM = 0.01
"""Share of the radius of the scene's bulk by which Grow and Shrink move the border."""
SUBJECT = ("it", "the subject", "subject", "the main subject")
"""Words for the main subject, which needs no object to be found."""


@dataclass(frozen=True)
class Clicks:
    """The clicks of one selection, in order, and what was selected before them."""

    clicks: tuple[Click, ...] = ()

    def with_click(self, click: Click, *, add: bool) -> Clicks:
        """With one more click; a plain one begins anew. Raises UsageError for a first one
        outside."""
        if not add:
            return Clicks((click,))
        if not self.clicks and not click.inside:
            raise UsageError("click on the object first; then take parts away")
        return replace(self, clicks=(*self.clicks, click))

    def region(self, selector: Selector) -> Region:
        """Gaussians that the clicks select. Raises UsageError as `Selector.at` does."""
        return selector.at(self.clicks)


def by_words(finder: Finder, phrase: str) -> Region:
    """Gaussians that words name: an object, a saved selection, the subject, the background.

    Raises UsageError for words that name nothing here, with what can be said.
    """
    phrase = phrase.strip().lower()
    if not phrase:
        raise UsageError("say what to select, as in “the red one” or “the largest”")
    return finder.subject if phrase in SUBJECT else finder.named(phrase)


def grown(scene: Gaussians, flags: Bool[Tensor, " n"], radius: float) -> Bool[Tensor, " n"]:
    """The selection and all within a radius of it, world units; shrunk by a negative one."""
    given = _Given(flags.numpy())
    selection = Grown(given, radius) if radius > 0 else Shrunk(given, -radius)
    return torch.from_numpy(selection.mask(table_of(scene)))


@dataclass(frozen=True, eq=False)
class _Given(WholeSelection):
    """Flags that are known already."""

    flags: Flags[np.ndarray, " n"]

    def mask(self, table: SplatTable) -> Flags[np.ndarray, " n"]:
        return self.flags
