"""Settings of an edit that every strategy shares."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any, Literal

from gsedit.capture.fitting.settings import UpdateSettings
from gsedit.errors import UsageError
from gsedit.paper.diffusion.settings import SamplerDefaults, SamplerSettings
from gsedit.paper.skips import DECISIONS, DecisionName
from rasterizer.numerics import AUTO, Execution

SMALLEST_EDIT_PIXELS = 16
"""Least longer side of an edited picture, as of the smallest view: editors need that much."""


FINEST = 0.4
"""Least width of strokes: views of 960 pixels. Finer ones take minutes a view, and gigabytes."""


@dataclass(frozen=True)
class EditSettings:
    """Everything that decides an edit but the scene, the instruction, the editor, the strategy
    and the seed. Raises UsageError for a value out of range."""

    sampler: SamplerSettings = field(default_factory=SamplerSettings)
    """How the 2D editor samples."""
    update: UpdateSettings = field(default_factory=UpdateSettings)
    """How the scene is fitted to the edited views."""
    views_per_batch: int = field(default=3, metadata={"flag": "--views"})
    """Views that are edited together."""
    batches: int | None = field(default=None, metadata={"flag": "--batches"})
    """Most batches of views that are edited. None: the editor's own (4; painter 6)."""
    coverage: float = 0.95
    """Stop after the batch that covers this share of what the camera set sees, in (0, 1]."""
    overlap: float = 0.5
    """Target overlap of the views of a batch, in [0, 1]: the mean share of what one view shows
    that the others show too. With more, views agree better, and more batches cover as much."""
    view_plan: Literal["covering", "random"] = "covering"
    """Choice of the views that are edited: those that see most of the scene and each other, or
    batches drawn at random, as many as may be edited."""
    anchors: int = 4
    """Most finished views that a batch is tied to, 0 or more. They cost comparisons, no evaluation
    of the network."""
    geometry: Literal["appearance", "full"] = field(
        default="appearance", metadata={"flag": "--geometry"}
    )
    """The part of the scene that moves: colors and opacities only, or positions and shapes too."""
    condition: Literal["render", "photo"] = field(
        default="render", metadata={"flag": "--condition"}
    )
    """The unedited picture that the editor is shown: a render of the scene, or the photo."""
    held_out_edits: int = 2
    """Held-out views that the 2D editor is asked for at the end, to compare the scene with: alone,
    and, if it is a diffusion model, tied to the targets too: then each costs two edits. 0: none."""
    edit_size: int | None = None
    """Longer side, pixels, of the pictures that the editor is given: of larger views it edits small
    ones, and the change is carried to full size; a network of --editor diffusers also edits large
    ones of smaller views. None: what the editor was made for."""
    brush: float = field(default=1.0, metadata={"flag": "--brush"})
    """Width of the strokes of --editor painter, from 0.4 to 10 times the usual: the larger, the
    smaller the pictures that it paints; at 1 they have 384 pixels."""
    region: str = field(default="auto", metadata={"flag": "--region"})
    """The region that may change. auto: the subject if the instruction is about it, else
    everything; all: everything; box:x0,y0,z0,x1,y1,z1 or sphere:x,y,z,r in the coordinates of the
    scene's file; FILE.npy: one flag a Gaussian (an edit writes region.npy); PHOTO.png with the name
    of one of the photos, white where the edit belongs, or a folder of such masks."""
    disable: str = field(default="", metadata={"flag": "--disable"})
    """Optimisations that the edit does without, by name and separated by commas, as in
    merging,views, or all: the work is done that they would skip. --explain lists them."""
    checkpoint_seconds: float = 30.0
    """Seconds between checkpoints, at least; the views of a batch are edited without one."""
    execution: Execution = AUTO
    """How pictures are rendered; it changes the run time, not the pictures."""

    def __post_init__(self) -> None:
        if self.region not in ("auto", "all"):
            from gsedit.select.where import check_region  # which loads numpy

            check_region(self.region)
        if unknown := self._disabled - {*DECISIONS, "all"}:
            raise UsageError(
                f"{', '.join(sorted(unknown))}: nothing that can be disabled; give some of "
                f"{', '.join(DECISIONS)}, or all"
            )
        if min(self.views_per_batch, self.most_batches) < 1:
            raise UsageError("views and batches must be 1 or more")
        if not FINEST <= self.brush <= 10:
            raise UsageError(f"brush is {self.brush:g}: give a number from {FINEST} to 10")
        if min(self.held_out_edits, self.anchors) < 0:
            raise UsageError("held-out edits and anchors must be 0 or more")
        if not self.checkpoint_seconds >= 0:
            raise UsageError(f"checkpoint_seconds is {self.checkpoint_seconds}: give 0 or more")
        if not 0 < self.coverage <= 1:
            raise UsageError(f"coverage {self.coverage} is not in (0, 1]")
        if self.edit_size is not None and self.edit_size < SMALLEST_EDIT_PIXELS:
            raise UsageError(
                f"the edit size is {self.edit_size} pixels: give {SMALLEST_EDIT_PIXELS} or more, "
                "or leave it out for the size that suits the editor"
            )
        if not 0 <= self.overlap <= 1:
            raise UsageError(f"overlap {self.overlap} is not in [0, 1]")

    @property
    def most_batches(self) -> int:
        """Most batches of views, where no editor has a number of its own."""
        return 4 if self.batches is None else self.batches

    @property
    def solves(self) -> bool:
        """Whether the colors that fit the targets are solved for: only they move, by the MSE."""
        return self.geometry == "appearance" and self.update.is_quadratic

    @property
    def _disabled(self) -> set[str]:
        return {name.strip() for name in self.disable.split(",") if name.strip()}

    def skips(self, name: DecisionName) -> bool:
        """Whether the work that this decision is about is skipped where it is not needed."""
        return not self._disabled & {name, "all"}


@dataclass(frozen=True)
class Preset:
    """Settings, and values of the fields of strategies that have them."""

    meaning: str
    settings: EditSettings = field(default_factory=EditSettings)
    strategy: Mapping[str, Any] = field(default_factory=dict)

    def applied_to(self, strategy: Any) -> Any:
        """The strategy with the preset's values in those of its fields."""
        own = {each.name for each in fields(strategy)}
        return replace(strategy, **{k: v for k, v in self.strategy.items() if k in own})


PRESETS = {
    "default": Preset("What gsedit does."),
    "quick": Preset(
        "Half of the evaluations of a 2D model (docs/measurements/editors.md).",
        EditSettings(sampler=SamplerSettings(guidance_every=3, guidance_end=1.0)),
    ),
    "paper": Preset(
        "Efficient-NeRF2NeRF as printed (docs/concepts/differences.md).",
        EditSettings(
            sampler=SamplerSettings(
                steps=50, solver="ddim", spacing="leading", strength=1.0, target="xt",
                noise="independent", t_end=SamplerDefaults().t_end,
                harmonise=False,
            ),
            update=UpdateSettings(loss="mse+0.1*gram"),
            views_per_batch=4, view_plan="random", anchors=0, geometry="full", region="all",
        ),
        {"update_steps": 200},
    ),
}  # fmt: skip


def find_preset(name: str) -> Preset:
    """Find a preset by its name. Raises UsageError for any other."""
    if name not in PRESETS:
        raise UsageError(f"preset must be one of {', '.join(PRESETS)}, not {name!r}")
    return PRESETS[name]
