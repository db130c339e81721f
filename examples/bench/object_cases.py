"""Cases of the benchmark: a staged scene, one thing of it, and the exact scene after a change."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from math import cos, radians, sin
from typing import Any

import numpy as np

from bench.staged import Stage, stage
from bench.staged.thing import Daylight
from gsedit.bench.synthetic.paint import plain
from gsedit.scene.similarity import Similarity

BLACK = (0.0, 0.0, 0.0)
"""Background of all cases: that of a renderer where no Gaussian is."""
PURPLE, BLUE = (0.5, 0.2, 0.65), (0.12, 0.25, 0.75)
EVENING = Daylight((0.8, 0.35, 0.45), (1.0, 0.62, 0.36), (0.3, 0.32, 0.45))
NOON = Daylight((-0.15, -0.25, 1.0), (0.95, 0.92, 0.85), (0.42, 0.46, 0.52))
SNOW = 0.06
"""Thickness of the snow on level places, world units."""


@dataclass(frozen=True)
class Case:
    """A change of one thing of a stage that an operation is asked for."""

    task: str
    stage: str
    subject: str
    """Name of the thing."""
    change: dict[str, Any] = field(default_factory=dict)
    """Numbers of the change, as whoever takes part reads them."""

    @property
    def name(self) -> str:
        """Name of its folder and of its result."""
        return f"{self.task}-{self.stage}"

    def before(self) -> Stage:
        """The stage that is given."""
        whole = on_black(self.stage)
        return whole.without(self.subject) if self.task == "insertion" else whole

    def after(self) -> Stage:
        """The stage after the change."""
        return AFTER[self.task](on_black(self.stage), self)


def on_black(name: str) -> Stage:
    """A stage before black."""
    return replace(stage(name), background=BLACK)


def placed(given: Stage, case: Case) -> Similarity:
    """The similarity by which a case moves its thing: turned and scaled about its foot, then moved
    along the ground."""
    angle = radians(case.change["turn_degrees"])
    turn = np.array(((cos(angle), -sin(angle), 0.0), (sin(angle), cos(angle), 0.0), (0, 0, 1.0)))
    about = Similarity(turn, case.change["scale"], np.zeros(3)).about(
        given.thing(case.subject).foot
    )
    shift = np.array(case.change["to"]) - given.thing(case.subject).foot
    return Similarity(turn, about.scale, about.translation + shift)


def _recolored(given: Stage, case: Case) -> Stage:
    coat = plain(case.change["color"])
    return given.with_thing(replace(given.thing(case.subject), coat=coat))


AFTER: dict[str, Callable[[Stage, Case], Stage]] = {
    "removal": lambda given, case: given.without(case.subject),
    "insertion": lambda given, case: given,
    "move": lambda given, case: given.moved(case.subject, placed(given, case)),
    "recolor": _recolored,
    "relight": lambda given, case: given.relit(Daylight(**case.change)),
    "growth": lambda given, case: given.snowed(case.change["thickness"], case.subject),
}
"""Exact result of each task."""


def _light(light: Daylight) -> dict[str, Any]:
    return {name: list(getattr(light, name)) for name in ("sun", "sunlight", "sky", "ground")}


def _to(x: float, y: float, z: float, scale: float = 1.0, turn: float = 0.0) -> dict[str, Any]:
    return {"to": [x, y, z], "scale": scale, "turn_degrees": turn}


CASES = (
    Case("removal", "pedestal", "orange statue"),
    Case("removal", "meadow", "red ball"),
    Case("removal", "wall", "blue crate"),
    Case("removal", "corner", "green ring"),
    Case("removal", "table", "large red ball"),
    Case("removal", "glimpse", "orange bollard"),
    Case("insertion", "pedestal", "orange statue"),
    Case("insertion", "meadow", "blue post"),
    Case("insertion", "table", "purple disc"),
    Case("move", "meadow", "red ball", _to(-0.45, -0.35, -0.45, 1.2, 60.0)),
    Case("move", "table", "white pillar", _to(0.0, 0.6, -0.15)),
    Case("move", "corner", "yellow box", _to(-0.2, -0.35, -0.45, 1.0, 30.0)),
    Case("recolor", "pedestal", "orange statue", {"color": PURPLE}),
    Case("recolor", "meadow", "red ball", {"color": BLUE}),
    Case("recolor", "table", "large red ball", {"color": PURPLE}),
    Case("relight", "pedestal", "orange statue", _light(EVENING)),
    Case("relight", "corner", "green ring", _light(NOON)),
    Case("relight", "table", "large red ball", _light(EVENING)),
    Case("growth", "pedestal", "orange statue", {"material": "snow", "thickness": SNOW}),
    Case("growth", "meadow", "red ball", {"material": "snow", "thickness": SNOW}),
    Case("growth", "table", "green box", {"material": "snow", "thickness": SNOW}),
)
"""All cases that change a scene; names are unique."""
