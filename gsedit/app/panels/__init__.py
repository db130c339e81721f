"""The controls of the page, heading by heading; each file adds one group of them to a tab."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from gsedit.app.panels import header

if TYPE_CHECKING:
    from gsedit.app.page import Page
    from gsedit.app.tab import Tab

PANELS: tuple[tuple[str, str, tuple[str, ...]], ...] = (
    ("Say", "message", ("say",)),
    ("Select", "pointer", ("select",)),
    ("Tools", "tools", ("clean", "crop", "transform", "measure")),
    ("History", "history", ("history",)),
    ("File", "folder", ("export",)),
)
"""Headings, their icons, and the modules below them, in order; `add` of each, a function or the
class of its controls, adds them."""


def add_panels(page: Page, tab: Tab) -> None:
    """Add all controls to a tab that was opened."""
    header.add(page, tab)
    group: Any = tab.gui.add_tab_group()
    for heading, icon, modules in PANELS:
        with group.add_tab(heading, icon):
            for name in modules:
                import_module(f"{__name__}.{name}").add(page, tab)
