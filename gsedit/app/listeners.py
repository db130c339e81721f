"""Tabs as a page knows them, and the functions that they want called."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, runtime_checkable


@runtime_checkable
class Screen(Protocol):
    """A tab, as far as its page knows it."""

    def refresh(self) -> None:
        """Show what the page has now."""
        ...

    def new_scene(self) -> None:
        """Show the page's scene alone: it is another."""
        ...

    def tell(self, text: str) -> None:
        """Tell that something has changed."""
        ...

    def fail(self, error: Exception | str) -> None:
        """Say what went wrong."""
        ...

    def close(self) -> None:
        """End what the tab has begun."""
        ...


class Audience:
    """Tabs of a page, and functions that are called after changes, each as long as its tab is
    open."""

    def __init__(self) -> None:
        """Begin without any tab."""
        self.tabs: list[Screen] = []
        self._functions: list[tuple[Screen, str, Callable[[], None]]] = []

    def join(self, tab: Screen) -> None:
        """Take a tab that was opened."""
        self.tabs.append(tab)

    def part(self, tab: Screen) -> None:
        """Forget a tab that was closed; work goes on without it."""
        if tab in self.tabs:
            self.tabs.remove(tab)
        self._functions = [each for each in self._functions if each[0] is not tab]
        tab.close()

    def listen(self, tab: Screen, what: str, function: Callable[[], None]) -> None:
        """Call a function after each change of the "scene", the "selection", the "document" or
        "busy", as long as the tab is open."""
        self._functions.append((tab, what, function))

    def notify(self, what: str) -> None:
        """Call the functions that listen to a change; what one raises its tab says."""
        for tab, each, function in list(self._functions):
            if each == what:
                try:
                    function()
                except Exception as error:
                    tab.fail(error)

    def say(self, text: str) -> None:
        """Say something in all tabs."""
        for tab in list(self.tabs):
            tab.tell(text)

    def fail(self, error: Exception | str) -> None:
        """Say in all tabs what went wrong."""
        for tab in list(self.tabs):
            tab.fail(error)
