"""What every 2D editor takes and gives. `v` views of `h w` pixels, `y x` latent cells."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.consistency.correspond import Correspondences
from gsedit.diffusion import SamplerSettings


@dataclass(frozen=True, eq=False)
class EditBatch:
    """Views that are edited together."""

    images: Float[Tensor, "v h w 3"]
    """Where sampling starts: current renders; for an anchored view its finished edited image."""
    originals: Float[Tensor, "v h w 3"]
    """The condition: photos or renders of the unedited scene; never an edited picture."""
    prompt: str
    correspondences: Correspondences | None = None
    """None: every view is edited on its own."""
    anchored: Bool[Tensor, " v"] | None = None
    """Views that are already edited: they stay as they are, and their clusters follow them."""
    seed: int = 0
    """The same for all batches of one edit: what corresponds to nothing starts alike everywhere."""


@dataclass(frozen=True, eq=False)
class EditProgress:
    """One step of an editor. Only the last one carries the images."""

    step: int
    steps: int
    images: Float[Tensor, "v h w 3"] | None = None
    """Edited views, in [0, 1], same size and order as the batch."""


@runtime_checkable
class Editor(Protocol):
    """A 2D editor of several views at once."""

    @property
    def name(self) -> str: ...

    @property
    def cell(self) -> int:
        """Pixels per latent cell: the grid on which correspondences are wanted."""
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
class Advises(Protocol):
    """An editor that can foresee where an instruction it accepts leads nowhere."""

    def advise(self, prompt: str) -> str:
        """What whoever asks should know before it works; empty where there is nothing to say."""
        ...


def advice_of(editor: object, prompt: str) -> str:
    """What an editor, or a denoiser, has to say about an instruction; most say nothing."""
    return editor.advise(prompt) if isinstance(editor, Advises) else ""


@runtime_checkable
class KnowsAnswer(Protocol):
    """An editor whose right answer is known: what is made of its pictures can be measured."""

    def answer(
        self,
        prompt: str,
        edited: Float[Tensor, "v h w 3"],
        originals: Float[Tensor, "v h w 3"],
    ) -> Callable[[Float[Tensor, "n h w 3"]], Float[Tensor, "n h w 3"]] | None:
        """The map from unedited to truly edited pictures that these views agreed on.

        None where the denoiser knows no answer.
        """
        ...
