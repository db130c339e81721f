"""Settings of the fit to photos and of the update to edited views."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, get_args

from gsedit.errors import UsageError
from gsedit.measures.losses import LossTerm, parse_loss
from rasterizer.numerics import AUTO, Execution

Exposure = Literal["auto", "on", "off"]

SMALLEST_PATCH = 16
"""Pixels a side: the coarsest filters under the Gram matrix reach this far."""
SMALLEST_PERCEPTUAL = 32
"""Pixels a side that the perceptual distance needs (gsedit.measures.perceptual.SMALLEST)."""


@dataclass(frozen=True)
class UpdateSettings:
    """How a scene is fitted to edited views. Raises UsageError for a value out of range."""

    loss: str = field(default="mse", metadata={"flag": "--loss"})
    """The terms of the loss, joined by +: mse, l1, dssim, gram, perceptual. A number before a term
    is its weight, as in 0.8*l1+0.2*dssim; gram alone has 30. By mse alone, colors are solved for
    exactly; by other losses, and with --geometry full, they are fitted in steps on random crops."""
    patches: int = 4
    """Random crops rendered in a step, where the scene is fitted in steps."""
    patch: int = 64
    """Side of a crop, pixels."""
    strokes: int = 24
    """Steps by which the strokes of drawn views are kept after the solve, for editors that draw
    (gsedit.capture.fitting.strokes). 0: none, and no view leads in the solve."""

    def __post_init__(self) -> None:
        if self.strokes < 0:
            raise UsageError(f"strokes is {self.strokes}: give 0 or more steps")
        if self.patches < 1 or self.patch < SMALLEST_PATCH:
            raise UsageError(
                f"patches must be 1 or more, and a patch {SMALLEST_PATCH} pixels or more, "
                f"not {self.patches} and {self.patch}"
            )
        names = [term.name for term in self.terms]
        if "perceptual" in names and self.patch < SMALLEST_PERCEPTUAL:
            raise UsageError(
                f"the loss perceptual needs patches of {SMALLEST_PERCEPTUAL} pixels or more, not "
                f"{self.patch}"
            )

    @property
    def terms(self) -> tuple[LossTerm, ...]:
        """Terms of the loss, in its order, without those of weight 0. Raises UsageError for a loss
        that cannot be read."""
        return parse_loss(self.loss)

    @property
    def is_quadratic(self) -> bool:
        """Whether the loss is the MSE alone: then colors solve linear equations."""
        return [term.name for term in self.terms] == ["mse"]


LEAST_STEPS = 10
"""Steps that are made after the seconds too: reading the photos may take all of a short budget."""


@dataclass(frozen=True)
class FitSettings:
    """How a scene is fitted to photos. Fractions are of the budget: of the steps or the seconds,
    whichever ends first. Raises UsageError for a value out of range."""

    steps: int | None = field(default=6_000, metadata={"flag": "--steps"})
    """Optimizer steps; None: as many as the time allows."""
    seconds: float | None = None
    """Wall-clock seconds; None: until the steps are done."""
    batch: int = field(default=1, metadata={"flag": "--batch"})
    """Photos in a step; their gradients are summed, and the learning rates are multiplied by the
    square root of their number."""
    sh_degree: int = field(default=1, metadata={"flag": "--sh-degree"})
    """Degree of the spherical harmonics, 0 to 3; higher ones cost time and memorise exposure."""
    dense_start: int = 40_000
    """Patches of the photos that a plane sweep looks for in space; a Gaussian starts at each that
    is found, beside those at the sparse points. 0: at the sparse points only."""
    coarse: tuple[tuple[float, int], ...] = ((0.1, 128), (0.5, 256), (0.9, 512))
    """(fraction, pixels) pairs: until this fraction of the budget, train on pictures with so many
    pixels on the longer side; then on the photos as they are."""
    dssim_weight: float = 0.2
    """Share of the structural dissimilarity in the loss; the rest is the L1 error."""
    exposure: Exposure = field(default="auto", metadata={"flag": "--exposure"})
    """Whether each photo is compared after an affine change of color of its own, so that the scene
    need not explain exposure and white balance. auto: where 10 or more photos differ in them."""
    max_gaussians: int = field(default=150_000, metadata={"flag": "--max-gaussians"})
    """The number of Gaussians grows to this, and never beyond."""
    densify_every: int = 100
    """Number of steps between densifications."""
    report_every: int = 10
    """Steps between progress events."""
    evaluations: int = 10
    """How many times the held-out views are measured."""
    checkpoint_seconds: float = field(default=30.0, metadata={"flag": "--checkpoint-every"})
    """Least seconds between two checkpoints."""
    execution: Execution = AUTO
    """How pictures are rendered; it changes the run time, not the pictures."""

    def __post_init__(self) -> None:
        if self.steps is None and self.seconds is None:
            raise UsageError("fit needs a budget: give --steps, --minutes or both")
        for name in ("steps", "seconds"):
            value = getattr(self, name)
            if value is not None and not value > 0:
                raise UsageError(f"the budget in {name} is {value}: give a number above 0")
        if self.batch < 1:
            raise UsageError(f"batch is {self.batch}: give 1 or more")
        if self.exposure not in get_args(Exposure):
            raise UsageError(f"exposure is {self.exposure!r}: {', '.join(get_args(Exposure))}")
        if not 0 <= self.sh_degree <= 3:
            raise UsageError(f"SH degree {self.sh_degree} is not in 0 to 3, what .ply files hold")
        if not self.dense_start >= 0:
            raise UsageError(f"dense_start is {self.dense_start}: give 0 or more")
        for name in ("max_gaussians", "densify_every", "report_every", "evaluations"):
            if not getattr(self, name) >= 1:
                raise UsageError(f"{name} is {getattr(self, name)}: give 1 or more")
        if not 0 <= self.dssim_weight <= 1:
            raise UsageError(f"dssim_weight is {self.dssim_weight}: give a number from 0 to 1")
        if not self.checkpoint_seconds >= 0:
            raise UsageError(f"checkpoint_seconds is {self.checkpoint_seconds}: give 0 or more")


@dataclass(frozen=True)
class Quality:
    """How well a scene is to be fitted, and how long that takes on two cores."""

    size: int
    """Longer side of the photos, pixels, at most."""
    settings: FitSettings


QUALITIES = {
    "draft": Quality(1024, FitSettings(steps=2_000, max_gaussians=100_000)),
    "normal": Quality(1024, FitSettings()),
    "high": Quality(1024, FitSettings(steps=16_000, max_gaussians=300_000, sh_degree=2)),
}
"""Steps decide, not seconds: a fit looks the same on a slow machine, and takes longer."""
