"""Cleaning: what is no part of the scene is colored and counted by reason before it goes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import torch

from gsedit.app.loaded import Loaded
from gsedit.scene.table import table_of
from gsedit.toolkit.clean import mark_unseen
from gsedit.toolkit.defects import UNSEEN
from gsedit.toolkit.find_defects import REASONS, find_defects

if TYPE_CHECKING:
    from gsedit.app.page import Page
    from gsedit.app.tab import Tab

SWITCHES = {
    "invisible": "invisible", "giant": "giants", "floater": "floaters", "needle": "needles",
    "duplicate": "duplicates", UNSEEN.name: "unseen",
}  # fmt: skip
"""Names of the reasons (gsedit.toolkit.find_defects.REASONS) and of their switches in `clean`."""


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


def add(page: Page, tab: Tab) -> None:
    """Add the reasons, each with its count and a switch, the preview and Clean."""
    gui = tab.gui
    look = gui.add_button("Find what does not belong", icon="zoom-question")
    boxes = {name: gui.add_checkbox(name, True, visible=False) for name in SWITCHES}
    told = gui.add_markdown("", visible=False)
    apply = gui.add_button("Remove it", icon="eraser", visible=False)
    state: list[Found] = []

    def chosen() -> torch.Tensor:
        wanted = [REASONS.index(name) for name, box in boxes.items() if box.value]
        flags = torch.from_numpy(np.isin(state[0].reasons, wanted))
        return flags if page.selection is None else flags & page.selection

    def show() -> None:
        known = bool(state) and page.has_scene and state[0].loaded is page.loaded
        told.visible = apply.visible = known
        counts = np.bincount(state[0].reasons, minlength=len(REASONS)) if known else []
        for name, box in boxes.items():
            box.visible = known and counts[REASONS.index(name)] > 0
        if not known:
            return tab.tint(None)
        flags = chosen()
        tab.tint(flags)
        some = " of the selection" if page.selection is not None else ""
        each = [f"{counts[REASONS.index(n)]:,} {n}" for n, b in boxes.items() if b.visible]
        told.content = f"{int(flags.sum()):,} Gaussians{some} would go: {', '.join(each) or 'none'}"

    def found(result: Found) -> None:
        state[:] = [result]
        show()

    def ended() -> None:
        state.clear()
        show()

    def clean() -> None:
        off = [f"--no-{SWITCHES[name]}" for name, box in boxes.items() if not box.value]
        file = page.selection_file()
        page.step("clean", *off, *(("--region", str(file)) if file else ()), title="clean")

    look.on_click(tab.safely(lambda _: tab.soon("clean", lambda: find(page.loaded), found)))
    apply.on_click(tab.safely(lambda _: clean()))
    for box in boxes.values():
        box.on_update(tab.safely(lambda _: show() if state else None))
    page.listen(tab, "scene", ended)
    page.listen(tab, "selection", lambda: show() if state else None)
