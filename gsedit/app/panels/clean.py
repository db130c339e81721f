"""Cleaning: what is no part of the scene is colored and counted by reason before it goes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import torch

from gsedit.app.loaded import Loaded
from gsedit.scene.table import table_of
from gsedit.toolkit.clean import mark_unseen
from gsedit.toolkit.defects import REASONS, UNSEEN, find_defects

if TYPE_CHECKING:
    from gsedit.app.page import Page
    from gsedit.app.tab import Tab

SWITCHES = {
    "invisible": "invisible", "giant": "giants", "floater": "floaters", "needle": "needles",
    "duplicate": "duplicates", UNSEEN.name: "unseen",
}  # fmt: skip
"""Names of the reasons (gsedit.toolkit.defects.REASONS) and of their switches in `clean`."""


@dataclass(frozen=True, eq=False)
class Found:
    """The reason of each Gaussian of one scene."""

    loaded: Loaded
    reasons: np.ndarray
    """Numbers of REASONS (n,); 0 is kept."""


def find(loaded: Loaded) -> Found:
    """Look for what is no part of a scene, as `gsedit clean` does."""
    table = table_of(loaded.scene)
    reasons = find_defects(table)
    cameras = [each.camera for each in loaded.recorded]
    mark_unseen(table, reasons, lambda scene, path: cameras, None)
    return Found(loaded, reasons)


class Clean:
    """The controls of one tab's cleaning."""

    def __init__(self, page: Page, tab: Tab) -> None:
        """Add the controls; nothing is looked for yet."""
        self.page, self.tab, gui = page, tab, tab.gui
        self.found: Found | None = None
        look = gui.add_button("Find what does not belong", icon="zoom-question")
        self.boxes = {name: gui.add_checkbox(name, True, visible=False) for name in SWITCHES}
        self.told = gui.add_markdown("", visible=False)
        self.remove = gui.add_button("Remove it", icon="eraser", visible=False)
        look.on_click(tab.safely(lambda _: self.look()))
        self.remove.on_click(tab.safely(lambda _: self.clean()))
        for box in self.boxes.values():
            box.on_update(tab.safely(lambda _: self.show()))
        tab.tools.append(lambda: self.take(None) if self.found else None)
        page.listen(tab, "scene", lambda: self.take(None))
        page.listen(tab, "selection", self.show)

    def look(self) -> None:
        """Look for it, in place of a preview."""
        self.tab.begin()
        self.told.visible, self.told.content = True, "Looking…"
        self.tab.soon("clean", lambda: find(self.page.loaded), self.take)

    def take(self, found: Found | None) -> None:
        """Show what was found, with all reasons on."""
        self.found = found
        counts = self.counts()
        for name, box in self.boxes.items():
            box.visible = counts[REASONS.index(name)] > 0
        self.told.visible = self.remove.visible = found is not None
        if found is None:
            self.tab.tint(None)
        self.show()

    def counts(self) -> np.ndarray:
        """Number of Gaussians for each of REASONS."""
        reasons = np.zeros(0, int) if self.found is None else self.found.reasons
        return np.bincount(reasons, minlength=len(REASONS))

    def show(self) -> None:
        """Color what would go, and count it."""
        if self.found is None or self.found.loaded is not self.page.loaded:
            return
        wanted = [REASONS.index(name) for name, box in self.boxes.items() if box.value]
        flags, selected = torch.from_numpy(np.isin(self.found.reasons, wanted)), ""
        if self.page.selection is not None:
            flags, selected = flags & self.page.selection, " of the selection"
        self.tab.tint(flags)
        counts = self.counts()
        each = [f"{counts[REASONS.index(n)]:,} {n}" for n, b in self.boxes.items() if b.visible]
        told = ", ".join(each) or "none"
        self.told.content = f"{int(flags.sum()):,} Gaussians{selected} would go: {told}"

    def clean(self) -> None:
        """Remove it; the rest is the next step."""
        off = [f"--no-{SWITCHES[name]}" for name, box in self.boxes.items() if not box.value]
        self.page.step("clean", *off, *self.page.region_options(), title="clean")


add = Clean
