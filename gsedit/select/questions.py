"""Expressions that look at a scene: `subject()`, `click(...)`, `thing(...)` and their like.

Loads no torch: what they ask is answered by a `gsedit.select.finder.Finder` of the scene.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Protocol

import numpy as np

from gsedit.errors import UsageError
from gsedit.scene.shapes import Bool
from gsedit.scene.table import SplatTable, gaussians_of
from gsedit.select.rules import Selection
from gsedit.select.short import FORMS, NUMBERS, expression_of
from gsedit.select.where import where

if TYPE_CHECKING:
    from gsedit.select.region import Region
    from rasterizer.scene import Gaussians


class Answers(Protocol):
    """Who looks at a scene: a `Finder`, whose methods say what each answer is."""

    def find_subject(self, *, base: bool = False) -> Region: ...
    def find_clicked(self, clicks: Sequence[tuple[str, float, float]]) -> Region: ...
    def find_thing(self, phrase: str) -> Region: ...
    def find_named(self, name: str) -> Region: ...
    def find_drawn(self, path: str) -> Region: ...
    def find_flags(self, path: str) -> Region: ...


def questions(
    finder: Callable[[Gaussians], Answers], tell: Callable[[Region], None] | None = None
) -> dict[str, Callable[..., Selection]]:
    """The functions of an expression that look at a scene, by name, for `gsedit.select.where`.

    `finder` makes the finder of a scene; `tell` is given what was found.
    """

    def ask(question: Callable[[Answers], Region]) -> Selection:
        def mask(table: SplatTable) -> Bool[np.ndarray, " n"]:
            found = question(finder(gaussians_of(table)))
            if tell is not None:
                tell(found)
            return found.inside.numpy()

        # the scene is rendered
        return Selection(mask, whole=True, view_dependent=True, question=question)

    def subject(base: bool = False) -> Selection:
        return ask(lambda f: f.find_subject(base=base))

    def click(view: str, x: float, y: float, *more: str | float) -> Selection:
        told = (view, x, y, *more)
        clicks = [told[i : i + 3] for i in range(0, len(told), 3)]
        if any([*map(type, each)] != [str, float, float] for each in clicks):
            raise UsageError("click: give a view, a column and a row for each click")
        return ask(lambda f: f.find_clicked(clicks))

    def thing(phrase: str) -> Selection:
        return ask(lambda f: f.find_thing(phrase))

    def named(name: str) -> Selection:
        return ask(lambda f: f.find_named(name))

    def mask(path: str) -> Selection:
        return ask(lambda f: f.find_drawn(path))

    def flags(path: str) -> Selection:
        return ask(lambda f: f.find_flags(path))

    every = (subject, click, thing, named, mask, flags)
    return {each.__name__: each for each in every}


def _unasked(scene: Gaussians) -> Answers:
    raise AssertionError("a rule that is only checked is never asked")


def check_region(
    text: str, functions: Mapping[str, Callable[..., Selection]] | None = None
) -> Selection:
    """The rule of an expression or a short form, before any file is read. Raises UsageError.

    `functions` look at a scene; without them the rule is only checked, never asked.
    """
    try:
        return where(expression_of(text), functions or questions(_unasked))
    except UsageError as error:
        if "(" in text or text.partition(":")[0] in NUMBERS:
            said = str(error)
            raise UsageError(said if said.startswith("region ") else f"region {said}") from None
        raise UsageError(f"region {text!r} is none that can be used: give {FORMS}") from None
