"""Any denoiser as an editor: encode, noise, sample with consensus, decode. `v` views of `h w`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, is_dataclass, replace
from functools import partial

import torch
import torch.nn.functional as F
from jaxtyping import Float, Int
from torch import Tensor

from gsedit.consistency.consensus import consensus, share_noise
from gsedit.diffusion import (
    Anchor,
    Answer,
    Denoiser,
    Hook,
    Predictor,
    SamplerSettings,
    Suits,
    add_noise,
    levels_of,
    predict_guided,
    sample,
    suits,
)
from gsedit.diffusion.machine import InBfloat16, faster, peak_bytes, views_at_once
from gsedit.editors.protocol import EditBatch, EditProgress, advice_of
from gsedit.errors import UsageError


@dataclass(frozen=True, eq=False)
class DiffusionEditor:
    """An Editor: the regularised sampler over one denoiser."""

    denoiser: Denoiser

    @property
    def name(self) -> str:
        return self.denoiser.name

    @property
    def cell(self) -> int:
        return self.denoiser.cell

    @property
    def suits(self) -> Suits:
        """What suits the denoiser."""
        return suits(self.denoiser)

    def check(self, prompt: str) -> None:
        """Raise UsageError if the denoiser cannot follow the instruction."""
        self.denoiser.check(prompt)

    def advise(self, prompt: str) -> str:
        """What the denoiser has to say about the instruction."""
        return advice_of(self.denoiser, prompt)

    def answer(
        self,
        prompt: str,
        edited: Float[Tensor, "v h w 3"],
        originals: Float[Tensor, "v h w 3"],
    ) -> Answer | None:
        """The true edit that most of these views show (see KnowsAnswer); None if unknowable."""
        return self.denoiser.answer(prompt, edited, originals)

    @torch.no_grad()
    def edit(
        self, batch: EditBatch, settings: SamplerSettings, generator: torch.Generator
    ) -> Iterator[EditProgress]:
        """Yields a step at a time. The generator draws the noise first, then the condition.

        Sides that are no multiples of the cell are padded right and below by their edge, so cells
        stay where they were, and cropped back. Raises UsageError for shapes that do not belong
        together, and whatever `check` raises.
        """
        self.check(batch.prompt)
        _check_shapes(batch)
        settings = settings.suited(self.suits)
        if batch.anchored is not None and batch.anchored.all():
            yield EditProgress(settings.steps, settings.steps, batch.images.clone())
            return
        height, width = batch.images.shape[1:3]
        originals = pad_to_cells(batch.originals, self.cell)
        images = pad_to_cells(batch.images, self.cell)
        z0 = self.denoiser.encode(images)
        anchor, free = None, slice(None)
        if batch.anchored is not None and batch.anchored.any():
            free = ~batch.anchored
            answers = z0.clone()
            answers[batch.anchored] = self.denoiser.encode_edited(
                images[batch.anchored], originals[batch.anchored], batch.prompt
            )
            anchor = Anchor(batch.anchored, answers)
        agree, share = _hooks(batch, settings, z0)

        noise = torch.randn(z0.shape, generator=generator, dtype=z0.dtype)
        condition = self.denoiser.condition(originals[free], batch.prompt, generator)
        start = levels_of(self.denoiser.schedule, settings)[0]
        noise = settings.in_force(self.suits).temperature * share(noise)
        x = add_noise(z0 if anchor is None else anchor.x0, noise, start)
        states = sample(
            prepared(self.denoiser, x[free], originals[free], batch.prompt, settings),
            condition,
            x,
            settings,
            consensus=agree,
            share=share,
            anchor=anchor,
            generator=generator,
        )
        for state in states:
            x = state.x
            if state.step < state.steps:
                yield EditProgress(state.step, state.steps)
        edited = batch.images.clone()
        images = self.denoiser.decode(x[free])[:, :height, :width]
        edited[free] = images.clamp(0, 1).to(edited.dtype)
        yield EditProgress(settings.steps, settings.steps, edited)


def prepared(
    denoiser: Denoiser, x: Tensor, originals: Tensor, prompt: str, settings: SamplerSettings
) -> Predictor:
    """The denoiser with as many views at once, and as few bits, as suit it and this machine.

    A network (see Denoiser) is measured on the first view: what a pass and a decoding hold in
    memory, and what bfloat16 would change. What computes without one is left alone.
    """
    if getattr(denoiser, "micro_batch", None) is None or not is_dataclass(denoiser):
        return denoiser
    first = levels_of(denoiser.schedule, settings)[0]
    condition = denoiser.condition(originals[:1], prompt, torch.Generator())

    def ask(asked: Predictor) -> Tensor:
        return predict_guided(asked, condition, x[:1], first, settings)

    held = max(peak_bytes(lambda: ask(denoiser)), peak_bytes(lambda: denoiser.decode(x[:1])))
    found = faster(denoiser, ask, settings.precision)
    views = views_at_once(len(x), held, settings.memory)
    sized = replace(denoiser, micro_batch=views)
    return sized if found is denoiser else InBfloat16(sized)


def pad_to_cells(images: Float[Tensor, "v h w c"], cell: int) -> Float[Tensor, "v H W c"]:
    """Repeat the last row and column until both sides are multiples of `cell`."""
    height, width = images.shape[1:3]
    below, right = -height % cell, -width % cell
    if not below and not right:
        return images
    padded = F.pad(images.movedim(-1, 1), (0, right, 0, below), mode="replicate")
    return padded.movedim(1, -1)


def _hooks(batch: EditBatch, settings: SamplerSettings, z0: Tensor) -> tuple[Hook | None, Hook]:
    """(consensus, noise sharing) of the batch."""
    if batch.correspondences is None:
        return None, lambda noise: noise
    labels = _labels_on(batch.correspondences.labels, z0)
    agree = partial(
        consensus, labels=labels, anchored=batch.anchored, strength=settings.consensus_strength
    )
    if settings.noise == "independent":
        return agree, lambda noise: noise
    return agree, _Sharing(labels, torch.Generator().manual_seed(batch.seed))


@dataclass(frozen=True, eq=False)
class _Sharing:
    """Noise that views have in common, and with them all batches of an edit: one set of draws."""

    labels: Int[Tensor, "v y x"]
    common: torch.Generator

    def __call__(self, noise: Float[Tensor, "v c y x"]) -> Float[Tensor, "v c y x"]:
        first = torch.randn(noise[:1].shape, generator=self.common, dtype=noise.dtype)
        return share_noise(torch.cat((first, noise[1:])), self.labels)


def _labels_on(labels: Int[Tensor, "v y x"], z0: Tensor) -> Int[Tensor, "v Y X"]:
    """The labels on the padded grid; cells that were added are in no cluster."""
    below, right = z0.shape[2] - labels.shape[1], z0.shape[3] - labels.shape[2]
    if len(labels) != len(z0) or not 0 <= below <= 1 or not 0 <= right <= 1:
        raise UsageError(
            f"correspondences are for {tuple(labels.shape)} views and cells, the images have "
            f"{(len(z0), *z0.shape[2:])}: match the cells of the images that are edited"
        )
    return F.pad(labels, (0, right, 0, below), value=-1)


def _check_shapes(batch: EditBatch) -> None:
    if batch.images.shape != batch.originals.shape:
        raise UsageError(
            f"images are {tuple(batch.images.shape)} and originals "
            f"{tuple(batch.originals.shape)}: an edit needs one original of the same size per view"
        )
    if not len(batch.images):
        raise UsageError("there is no view to edit: give at least one")
