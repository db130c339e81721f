"""Any denoiser as an editor: encode, noise, sample with consensus, decode.

`v` views of `h w` pixels, padded to `H W`; `c y x` latents.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, TypeVar

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from gsedit.errors import UsageError
from gsedit.paper.consistency.consensus import consensus, share_noise
from gsedit.paper.diffusion.guidance import (
    Around,
    Branches,
    Guided,
    Need,
    Predictor,
    branches_of,
    needed,
)
from gsedit.paper.diffusion.precision import InBfloat16, most_bytes, with_precision
from gsedit.paper.diffusion.sampler import Anchor, Hook, add_noise, sample
from gsedit.paper.diffusion.settings import SamplerSettings
from gsedit.paper.editors.protocol import (
    Capabilities,
    Cost,
    Denoiser,
    EditBatch,
    EditProgress,
    levels_for,
)
from gsedit.views.image_ops import pad_to, pad_to_multiple, round_up

T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class DiffusionEditor:
    """An Editor: the regularised sampler over one denoiser."""

    denoiser: Denoiser
    known: dict[Any, bool] = field(default_factory=dict, repr=False)
    """Whether the denoiser is taken in bfloat16, by size and settings of a batch."""

    @property
    def name(self) -> str:
        return self.denoiser.name

    @property
    def cell(self) -> int:
        return self.denoiser.cell

    @property
    def capabilities(self) -> Capabilities:
        """The denoiser's, and the denoiser itself."""
        declared = self.denoiser.capabilities
        return replace(
            declared,
            denoiser=declared.denoiser or self.denoiser,
            measure=self.measure if declared.runs_network else None,
        )

    def check(self, prompt: str) -> None:
        """Raise UsageError if the denoiser cannot follow the instruction."""
        self.denoiser.check(prompt)

    @torch.no_grad()
    def edit(
        self, batch: EditBatch, settings: SamplerSettings, generator: torch.Generator
    ) -> Iterator[EditProgress]:
        """Yields a step at a time. The generator draws the noise first, then the condition.

        Pictures are padded to the sides that the denoiser wants, right and below, and cropped
        back: cells stay where they were, and those that are added correspond to nothing. Raises
        UsageError for shapes that do not belong together, and whatever `check` raises.
        """
        self.check(batch.prompt)
        _check_shapes(batch)
        denoiser = self.denoiser
        settings = settings.with_defaults(denoiser.capabilities.defaults)
        if batch.anchored is not None and batch.anchored.all():
            yield EditProgress(settings.step_count, settings.step_count, batch.images.clone())
            return
        whole = padded(batch, self.denoiser)
        free = _free(batch)
        z0, anchor = _encoded(whole, self.denoiser)
        agree, share = _hooks(whole, settings)
        noise = torch.randn(z0.shape, generator=generator, dtype=z0.dtype)
        rows, columns = z0.shape[2:]
        levels = levels_for(denoiser, settings, (rows, columns))
        first = levels[0] if settings.strength < 1 else levels[0]._replace(a=0.0, b=1.0)
        x = add_noise(z0, share(noise), first)
        originals = whole.originals[free]
        condition = denoiser.condition(originals, batch.prompt, generator)
        counted = Counted(
            *prepared(denoiser, x[free], originals, batch.prompt, settings, self.known)
        )
        steps = sample(
            counted, condition, x, settings, levels=levels, consensus=agree, share=share,
            anchor=anchor, generator=generator,
        )  # fmt: skip
        for step in steps:
            x = step.x
            if step.step < step.steps:
                yield EditProgress(step.step, step.steps, None, counted.evaluations)
        images = _completed(batch, self.denoiser.decode(x[free]))
        yield EditProgress(len(levels) - 1, len(levels) - 1, images, counted.evaluations)

    @torch.no_grad()
    def measure(self, batch: EditBatch, settings: SamplerSettings) -> Cost:
        """The cost of a view of such a batch, measured by evaluating the network. Draws nothing
        from anyone's generator. Raises what `edit` raises."""
        self.check(batch.prompt)
        denoiser = self.denoiser
        settings = settings.with_defaults(denoiser.capabilities.defaults)
        whole = padded(batch, self.denoiser)
        z0 = denoiser.encode(whole.images)
        rows, columns = z0.shape[2:]
        levels = levels_for(denoiser, settings, (rows, columns))
        noise = torch.randn(z0.shape, generator=torch.Generator().manual_seed(0))
        x, originals = add_noise(z0, noise.to(z0), levels[0]), whole.originals
        predictor, spent = prepared(denoiser, x, originals, batch.prompt, settings, self.known)
        condition, condition_s = _timed(
            lambda: denoiser.condition(originals, batch.prompt, torch.Generator())
        )
        _, encode_s = _timed(lambda: denoiser.encode(whole.images[:1]))
        _, decode_s = _timed(lambda: denoiser.decode(x[:1]))
        (_, first), (_, second) = (  # the first may compile
            _timed(lambda: Guided(predictor, condition, settings)(x, levels[0])) for _ in range(2)
        )
        evaluations = len(x) * sum(needed(*settings.scales))
        return Cost(
            steps=len(levels) - 1,
            evaluations=sum(branches_of(levels, settings)),
            evaluation_s=min(first, second) / evaluations,
            encode_s=encode_s,
            decode_s=decode_s,
            peak_bytes=most_bytes(),
            precision="bfloat16" if isinstance(predictor, InBfloat16) else "float32",
            spent=spent + 2 * evaluations,
            condition_s=condition_s / len(x),
        )


def prepared(
    denoiser: Denoiser,
    x: Float[Tensor, "v c y x"],
    originals: Float[Tensor, "v h w 3"],
    prompt: str,
    settings: SamplerSettings,
    known: dict[Any, bool],
) -> tuple[Predictor, int]:
    """The denoiser, in bfloat16 where its settings ask for that or it is exact enough, and the
    evaluations that it took to find out, on the first view.

    `known` keeps what was found, for other batches of the same size and settings. A denoiser that
    runs no network is left alone.
    """
    if not denoiser.capabilities.runs_network or settings.precision == "float32":
        return denoiser, 0
    key, spent = (x.shape[1:], settings), 0
    if key not in known:
        first = levels_for(denoiser, settings, (x.shape[2], x.shape[3]))[0]
        condition = denoiser.condition(originals[:1], prompt, torch.Generator())

        def predict(predictor: Predictor) -> Tensor:
            nonlocal spent
            spent += sum(needed(*settings.scales))
            return Guided(predictor, condition, settings)(x[:1], first)

        known[key] = with_precision(denoiser, predict, settings.precision) is not denoiser
    return (InBfloat16(denoiser) if known[key] else denoiser), spent


def _timed(work: Callable[[], T]) -> tuple[T, float]:
    """(result, seconds of wall time)."""
    started = time.monotonic()
    return work(), time.monotonic() - started


class Counted(Around):
    """A predictor that counts the evaluations of its network."""

    def __init__(self, network: Predictor, evaluations: int = 0) -> None:
        super().__init__(network)
        self.evaluations = evaluations
        """Views times conditions, summed over the calls; those that were spent before included."""

    def branches(
        self, x: Float[Tensor, "v c y x"], t: float, condition: Any, need: Need
    ) -> Branches:
        """Branches of the wrapped predictor, counted."""
        self.evaluations += len(x) * sum(need)
        return self.network.branches(x, t, condition, need)


def padded(batch: EditBatch, denoiser: Denoiser) -> EditBatch:
    """The batch with the sides that the denoiser wants; added cells are in no cluster."""
    images, originals = (
        pad_to_multiple(pictures, denoiser.multiple, denoiser.padding)
        for pictures in (batch.images, batch.originals)
    )
    matches = batch.correspondences
    if matches is not None:
        labels = _padded_labels(matches.labels, batch.images, images, denoiser.cell)
        matches = replace(matches, labels=labels)
    return replace(batch, images=images, originals=originals, correspondences=matches)


def _padded_labels(
    labels: Int[Tensor, "n y x"],
    images: Float[Tensor, "v h w 3"],
    whole: Float[Tensor, "v H W 3"],
    cell: int,
) -> Int[Tensor, "v Y X"]:
    """The labels of all cells of the padded pictures; -1 (no cluster) where there were none.

    Raises UsageError unless there is one for every whole cell of the pictures.
    """
    views, *sides = images.shape[:3]
    rows, columns = (side // cell for side in whole.shape[1:3])
    fits = all(
        side // cell <= cells <= most
        for side, cells, most in zip(sides, labels.shape[1:], (rows, columns))
    )
    if len(labels) != views or not fits:
        grid = tuple(round_up(side, cell) // cell for side in sides)
        raise UsageError(
            f"correspondences are for {tuple(labels.shape)} views and cells, the images have "
            f"{(views, *grid)}: match the cells of the images that are edited"
        )
    return pad_to(labels, rows, columns, "constant", value=-1)


def _free(batch: EditBatch) -> Int[Tensor, " n"]:
    """Indices of the views that are not anchored."""
    every = torch.arange(len(batch.images))
    return every if batch.anchored is None else every[~batch.anchored]


def _completed(batch: EditBatch, decoded: Float[Tensor, "n H W 3"]) -> Float[Tensor, "v h w 3"]:
    """The edited pictures in [0, 1], of the free views; anchored ones as they are."""
    height, width = batch.images.shape[1:3]
    images = batch.images.clone()
    images[_free(batch)] = decoded[:, :height, :width].clamp(0, 1).to(images.dtype)
    return images


def _encoded(
    batch: EditBatch, denoiser: Denoiser
) -> tuple[Float[Tensor, "v c y x"], Anchor | None]:
    """(clean latents, those of the anchored views as finished edits)."""
    z0 = denoiser.encode(batch.images)
    anchored: Bool[Tensor, " v"] | None = batch.anchored
    if anchored is None or not anchored.any():
        return z0, None
    z0 = z0.clone()
    finished, originals = batch.images[anchored], batch.originals[anchored]
    z0[anchored] = denoiser.encode_edited(finished, originals, batch.prompt)
    return z0, Anchor(anchored, z0)


def _hooks(batch: EditBatch, settings: SamplerSettings) -> tuple[Hook | None, Hook]:
    """(consensus, noise sharing) of a padded batch."""
    if batch.correspondences is None:
        return None, lambda noise: noise
    labels, common = batch.correspondences.labels, torch.Generator().manual_seed(batch.seed)
    agree = partial(consensus, labels=labels, anchored=batch.anchored)
    if settings.noise == "independent":
        return agree, lambda noise: noise

    def shared(noise: Float[Tensor, "v c y x"]) -> Float[Tensor, "v c y x"]:
        # views have these draws in common, and with them all batches of an edit
        first = torch.randn(noise[:1].shape, generator=common, dtype=noise.dtype)
        return share_noise(torch.cat((first, noise[1:])), labels)

    return agree, shared


def _check_shapes(batch: EditBatch) -> None:
    if batch.images.shape != batch.originals.shape:
        raise UsageError(
            f"images are {tuple(batch.images.shape)} and originals "
            f"{tuple(batch.originals.shape)}: an edit needs one original of the same size per view"
        )
    if not len(batch.images):
        raise UsageError("there is no view to edit: give at least one")
    for what, pictures in (("image", batch.images), ("original", batch.originals)):
        bad = [i for i, each in enumerate(pictures) if not each.isfinite().all()]
        if bad:
            raise UsageError(
                f"the {what} of view {bad[0]} (of {len(pictures)}, from 0) holds NaN or infinity: "
                "a network would spread it over the views; mend the picture or leave it out"
            )
