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


class Listeners:
    """Functions that are called after changes, each as long as its tab is open."""

    def __init__(self) -> None:
        """Begin without any listener."""
        self._functions: list[tuple[Screen, str, Callable[[], None]]] = []

    def add(self, tab: Screen, what: str, function: Callable[[], None]) -> None:
        """Call a function of a tab after each change of that name."""
        self._functions.append((tab, what, function))

    def forget(self, tab: Screen) -> None:
        """Call no function of a tab any more."""
        self._functions = [each for each in self._functions if each[0] is not tab]

    def call(self, what: str) -> None:
        """Call the functions of a change; what one raises its tab says."""
        for tab, each, function in list(self._functions):
            if each == what:
                try:
                    function()
                except Exception as error:
                    tab.fail(error)
