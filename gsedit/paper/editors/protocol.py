"""Protocol of 2D editors. `v` views of `h w` pixels, `y x` latent cells."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple, Protocol, runtime_checkable

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.paper.consistency.correspond import Correspondences
from gsedit.paper.diffusion.guidance import Predictor
from gsedit.paper.diffusion.sampler import levels_of
from gsedit.paper.diffusion.schedules import NoiseLevel
from gsedit.paper.diffusion.settings import SamplerDefaults, SamplerSettings
from gsedit.views.image_ops import PadMode
from gsedit.words.instruction import Instruction

GroundTruth = Callable[[Float[Tensor, "n h w 3"]], Float[Tensor, "n h w 3"]]
"""A map from unedited to truly edited pictures, values in [0, 1]."""


class Places(NamedTuple):
    """Places of the pixels of views, in the unedited scene."""

    depths: Float[Tensor, "v h w"]
    """Median depth without grain; the farthest where nothing is."""
    points: Float[Tensor, "v h w 3"]
    """From the middle of all cameras, over the mean size of a pixel there: what is drawn by them is
    at the same place in all views, and about as large in each."""
    up: Float[Tensor, "3"]
    """Mean of the cameras' upward directions, not of unit length."""
    tones: tuple[float, float]
    """Luminance of the scene's darkest and brightest parts."""


@dataclass(frozen=True, eq=False)
class EditBatch:
    """Views that are edited together."""

    images: Float[Tensor, "v h w 3"]
    """Pictures at which sampling starts: current renders; for an anchored view its finished edited
    image."""
    originals: Float[Tensor, "v h w 3"]
    """The condition: photos or renders of the unedited scene; never an edited picture."""
    prompt: str
    correspondences: Correspondences | None = None
    """None: every view is edited on its own. What they are used for is the settings' `consensus`
    and `noise`."""
    anchored: Bool[Tensor, " v"] | None = None
    """Views that are already edited: they stay as they are, and their clusters follow them."""
    seed: int = 0
    """Seed that all batches of one edit share: cells without a correspondence start with the same
    noise in all of them."""
    subject: Float[Tensor, "v h w"] | None = None
    """The probability that a pixel shows what is to be edited. None: the editor decides."""
    places: Places | None = None
    """Places of pixels, for editors that draw by rules; None: not known."""


@dataclass(frozen=True, eq=False)
class EditProgress:
    """One step of an editor. Only the last one carries the images."""

    step: int
    steps: int
    images: Float[Tensor, "v h w 3"] | None = None
    """Edited views, in [0, 1], same size and order as the batch."""
    evaluations: int = 0
    """Evaluations of the network for this batch so far: a view at one noise level under one
    condition is one. 0 for editors that run none."""


@dataclass(frozen=True)
class Cost:
    """Measured cost of editing a view, in seconds of wall time."""

    steps: int
    evaluations: int
    """Evaluations of the network for one view: branches, summed over the steps."""
    evaluation_s: float
    encode_s: float
    decode_s: float
    peak_bytes: int
    """Most memory of the whole process so far, one evaluation and a decoding included; 0 where the
    system does not say."""
    precision: Literal["float32", "bfloat16"]
    spent: int = 0
    """Evaluations that measuring took."""
    condition_s: float = 0.0
    """For a view's share of what no step changes: the text encoder, and the original."""

    def seconds(self, views: int) -> float:
        """Seconds for so many views: each is sampled, decoded, and encoded before and after."""
        each = self.evaluations * self.evaluation_s + 2 * self.encode_s + self.decode_s
        return views * (each + self.condition_s)


@dataclass(frozen=True, eq=False)
class Capabilities:
    """Optional properties that several editors, or denoisers, declare besides their methods.
    `Capabilities()` declares nothing; an editor around another forwards the other's record."""

    defaults: SamplerDefaults = field(default_factory=SamplerDefaults)
    """Defaults for the sampler's settings that are None."""
    denoiser: Denoiser | None = None
    """The diffusion model, which tells that pictures are sampled from noise; None where there is
    none. A denoiser's own record leaves it None: the editor around it fills it in."""
    runs_network: bool = False
    """Whether this denoiser evaluates a network: its cost is measured, and it may be rounded."""
    best_size: int | None = None
    """Longer side, pixels, of the pictures that it edits best: larger views are edited at this size
    and the change is carried up. None: any size."""
    enlarges: bool = False
    """Whether smaller views are edited at `best_size` too, and the change is carried down: for
    networks that draw something else at a size that they were not trained at."""
    levels: Callable[[SamplerSettings, tuple[int, int]], list[NoiseLevel]] | None = None
    """(settings, rows and columns of latent cells) -> the levels that sampling steps between, for
    schedules that depend on the picture's size or on the number of steps. None: those that the
    settings divide the schedule into."""
    measure: Callable[[EditBatch, SamplerSettings], Cost] | None = None
    """Measure what a view costs, by one evaluation for a batch. None where that is little, or
    unknown."""


@runtime_checkable
class Editor(Protocol):
    """A 2D editor of several views at once."""

    @property
    def name(self) -> str:
        """Name of the editor, as in `--editor NAME`."""
        ...

    @property
    def cell(self) -> int:
        """Pixels per latent cell: the grid on which correspondences are wanted."""
        ...

    @property
    def capabilities(self) -> Capabilities:
        """Everything optional; `Capabilities()` if there is nothing to declare."""
        ...

    def check(self, prompt: str) -> None:
        """Raise UsageError, with the next move, if this editor cannot follow the instruction."""
        ...

    def edit(
        self, batch: EditBatch, settings: SamplerSettings, generator: torch.Generator
    ) -> Iterator[EditProgress]:
        """Edit the batch; yields at least once, the last item with the images."""
        ...


@runtime_checkable
class StylePainter(Editor, Protocol):
    """An editor of the painting styles that gsedit.words reads, each in the part of the scene that
    it is said of. No two views place a stroke alike: views are not matched, and the scene follows
    one view where that leads, and the pictures' style (gsedit.capture.fitting.strokes)."""

    @property
    def stroke_batches(self) -> int:
        """Most batches of views where the settings leave it open."""
        ...

    @property
    def rules(self) -> tuple[str, ...]:
        """Rules by which it draws what is asked for."""
        ...

    def in_styles(self, names: tuple[str, ...]) -> Editor:
        """A painter of these styles, mixed, whatever the prompt: the sentence has been read.
        Raises UsageError for a picture's style without a picture."""
        ...


def following(editor: Editor, step: Instruction) -> Editor:
    """The editor as it follows a step that was read: a painter its styles, another its words.

    Raises UsageError, with the next move, where it cannot.
    """
    if isinstance(editor, StylePainter):
        return editor.in_styles(tuple(dict.fromkeys(each.name for each in step.changes)))
    editor.check(step.text)
    return editor


@runtime_checkable
class KnowsTruth(Protocol):
    """An editor, or its denoiser, whose true edit is known: the error of an edit can be measured.
    The true edit is of whole pictures, and so are the instructions."""

    def find_ground_truth(
        self, prompt: str, edited: Float[Tensor, "v h w 3"], originals: Float[Tensor, "v h w 3"]
    ) -> GroundTruth | None:
        """The true edit that these views of an edit agreed on, or None."""
        ...


def truth_of(editor: Editor | None) -> KnowsTruth | None:
    """The editor or its denoiser, whichever knows the true edit; None where neither does."""
    sources = () if editor is None else (editor, editor.capabilities.denoiser)
    return next((each for each in sources if isinstance(each, KnowsTruth)), None)


@runtime_checkable
class Autoencoder(Protocol):
    """Pictures to latents and back."""

    @property
    def cell(self) -> int:
        """Pixels per latent cell."""
        ...

    @property
    def multiple(self) -> int:
        """Pixels, a multiple of `cell`: both sides of a picture to encode are multiples of it."""
        ...

    @property
    def padding(self) -> PadMode:
        """How a picture is continued to such sides."""
        ...

    def encode(self, images: Float[Tensor, "v h w 3"]) -> Float[Tensor, "v c y x"]:
        """Latents, scaled as the sampler wants them, of images in [0, 1]. Differentiable in the
        images, which may leave [0, 1] a little: score distillation descends through it."""
        ...

    def encode_edited(
        self, images: Float[Tensor, "v h w 3"], originals: Float[Tensor, "v h w 3"], prompt: str
    ) -> Float[Tensor, "v c y x"]:
        """Latents of finished edits of these originals: what anchored views are held to."""
        ...

    def decode(self, latents: Float[Tensor, "v c y x"]) -> Float[Tensor, "v h w 3"]:
        """Images, not clamped: the inverse of encode as far as there is one."""
        ...


@runtime_checkable
class Denoiser(Predictor, Autoencoder, Protocol):
    """A diffusion model of edited images, in its own latent space. Stateless."""

    @property
    def capabilities(self) -> Capabilities:
        """Everything optional, without `denoiser`."""
        ...

    def check(self, prompt: str) -> None:
        """Raise UsageError, with the next move, for an instruction it cannot follow."""
        ...

    def condition(
        self, originals: Float[Tensor, "v h w 3"], prompt: str, generator: torch.Generator
    ) -> Any:
        """Whatever `branches` needs and no step changes; computed once for the views."""
        ...


def levels_for(
    denoiser: Denoiser, settings: SamplerSettings, cells: tuple[int, int]
) -> list[NoiseLevel]:
    """The levels that a denoiser steps between, for pictures of `cells` (rows, columns)."""
    levels = denoiser.capabilities.levels
    return levels(settings, cells) if levels else levels_of(denoiser.schedule, settings)
