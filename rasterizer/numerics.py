"""Settings of a picture: its meaning (Numerics) and its computation (Execution), with reasons."""

from __future__ import annotations

import math
from collections.abc import Generator
from contextvars import ContextVar
from dataclasses import dataclass, field
from typing import Any, Literal, TypeVar, get_args

SH_DC = 0.28209479177387814
"""Y_00 = 1 / (2 sqrt(pi)), the value of the first spherical harmonic."""


def sh_to_color(dc: Any) -> Any:
    """Turn coefficients of the first SH band (array or tensor, any shape) into RGB."""
    return 0.5 + SH_DC * dc


def color_to_sh(color: Any) -> Any:
    """Turn RGB (array or tensor, any shape) into coefficients of the first SH band."""
    return (color - 0.5) / SH_DC


@dataclass(frozen=True)
class Numerics:
    """Meaning of the picture. The defaults are gsplat's, except the stop: scenes look the same."""

    alpha_max: float = 0.99
    """One splat never hides everything. At least 0.01 passes each, so that the stop below takes
    three opaque ones (at gsplat's 1e-4, two)."""
    alpha_min: float = 1 / 255
    """Below it, one step of an 8-bit picture, alpha is 0; it bounds every footprint."""
    transmittance_min: float = 1e-5
    """The stop: a tile is finished when at most this passes each of its pixels (the C++ kernel's
    blocks of pixels, when a fifth of it does), which is also the largest error of a color in
    [0, 1]. 0: every Gaussian is summed. At gsplat's 1e-4 the gradients
    of opacities behind a nearly opaque splat, which divide what is left out by 1 - alpha, were
    wrong by 1.5e-3; at 1e-5 by 6e-5, for 5 % more time."""
    gradient_min: float = 0.0
    """A Gaussian that carries less than this of a pixel gets no gradient from it; the picture is
    the same. 0, the default: gradients are the picture's. Adam moves a Gaussian as far for a tiny
    gradient as for a large one, so that an edit colors hidden ones at random."""
    blur: float = 0.3
    """Variance added to each projected covariance, square pixels (EWA low-pass)."""
    antialiased: bool = False
    """Scale each opacity by sqrt(det(covariance) / det(covariance + blur)), so that the blur adds
    nothing to the picture (Mip-Splatting, arXiv 2311.16493)."""
    near: float = 0.01
    """Splats are drawn whose center is farther than this: world units along the view. Below 0 only
    for an orthographic camera. A camera's own `near` goes before it."""
    far: float = math.inf
    """And not farther than this."""
    radius_clip: float = 0.0
    """Splats are not drawn whose footprint reaches at most this many pixels from its center, both
    across and down, each rounded up to whole pixels. Leaving out distant splats saves time."""
    margin: float = 0.3
    """The projection's Jacobian is taken at most this far off the picture, as a fraction of half
    the picture's width or height."""

    @property
    def log_alpha_max(self) -> float:
        return math.log(self.alpha_max)

    @property
    def log_alpha_min(self) -> float:
        return math.log(self.alpha_min)


DEFAULT = Numerics()
Kernel = Literal["auto", "torch", "compiled"]


@dataclass(frozen=True)
class Execution:
    """How the picture is computed: changes time, memory and rounding only."""

    tile_size: int | None = None
    """Side of a tile, pixels; None: chosen from the splats' footprints."""
    kernel: Kernel = field(default="auto", metadata={"flag": "--kernel"})
    """Renderer: a C++ kernel, compiled once per machine, or torch. They are equal within
    rounding. auto: the kernel, which is faster, where a C++ compiler is found."""

    def __post_init__(self) -> None:
        if self.tile_size is not None and self.tile_size < 1:
            raise ValueError(
                f"tile_size is {self.tile_size}: give 1 or more, or None to choose one"
            )
        if self.kernel not in get_args(Kernel):
            raise ValueError(f"kernel is {self.kernel!r}: {', '.join(get_args(Kernel))}")


AUTO = Execution()
_RULING: ContextVar[Execution] = ContextVar("ruling execution", default=AUTO)
T = TypeVar("T")
R = TypeVar("R")


def rule(execution: Execution) -> None:
    """Let an execution rule all that this context renders from now on, unless it is AUTO, or
    another is given there."""
    _RULING.set(ruling(execution))


def under(execution: Execution, steps: Generator[T, None, R]) -> Generator[T, None, R]:
    """The steps of a generator, with an execution that rules all that they render."""
    try:
        while True:
            token = _RULING.set(ruling(execution))
            try:
                step = next(steps)
            except StopIteration as ended:
                return ended.value
            finally:
                _RULING.reset(token)
            yield step
    finally:
        steps.close()


def ruling(execution: Execution) -> Execution:
    """An execution; for AUTO, the one that rules."""
    return _RULING.get() if execution == AUTO else execution
