"""The controls of the page, heading by heading; each file adds one group of them to a tab."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gsedit.app.page import Page
    from gsedit.app.tab import Tab

HEADINGS: tuple[tuple[str, str, tuple[str, ...]], ...] = (
    ("Select", "pointer", ("select",)),
    ("Tools", "tools", ("clean", "transform", "measure", "compare")),
    ("File", "folder", ("export",)),
)
"""Headings below the box, their icons, and the modules below them, in order; `add` of each, a
function or the class of its controls, adds them."""


def add_panels(page: Page, tab: Tab) -> None:
    """Add all controls to a tab that was opened: first the box and the history, which are always
    there."""
    for name in ("header", "history", "say"):
        import_module(f"{__name__}.{name}").add(page, tab)
    group: Any = tab.gui.add_tab_group()
    for heading, icon, modules in HEADINGS:
        with group.add_tab(heading, icon):
            for name in modules:
                import_module(f"{__name__}.{name}").add(page, tab)
