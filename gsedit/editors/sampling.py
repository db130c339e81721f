"""Any denoiser as an editor: encode, noise, sample with consensus, decode.

`v` views of `h w` pixels, padded to `H W`; `c y x` latents.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from gsedit.consistency.consensus import consensus, share_noise
from gsedit.datasets.padding import pad_to, pad_to_multiple, round_up
from gsedit.diffusion.guidance import Branches, Need, Predictor
from gsedit.diffusion.memory import peak_bytes, views_at_once
from gsedit.diffusion.precision import InBfloat16, with_precision
from gsedit.diffusion.predictions import Prediction
from gsedit.diffusion.sampler import Anchor, Hook, add_noise, levels_of, predict_guided, sample
from gsedit.diffusion.schedules import Schedule
from gsedit.diffusion.settings import SamplerSettings
from gsedit.editors.protocol import Capabilities, Denoiser, EditBatch, EditProgress
from gsedit.errors import UsageError
from gsedit.runs.ranks import ALONE, Ranks


@dataclass(frozen=True, eq=False)
class DiffusionEditor:
    """An Editor: the regularised sampler over one denoiser."""

    denoiser: Denoiser
    ranks: Ranks = ALONE
    """Among which views are shared out, if the denoiser runs a network."""

    @property
    def name(self) -> str:
        return self.denoiser.name

    @property
    def cell(self) -> int:
        return self.denoiser.cell

    @property
    def capabilities(self) -> Capabilities:
        """The denoiser's, the denoiser itself, and that views can be shared out."""
        return replace(
            self.denoiser.capabilities,
            denoiser=self.denoiser,
            with_ranks=lambda ranks: replace(self, ranks=ranks),
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
        settings = settings.with_defaults(self.denoiser.capabilities.defaults)
        if batch.anchored is not None and batch.anchored.all():
            yield EditProgress(settings.steps, settings.steps, batch.images.clone())
            return
        whole = padded(batch, self.denoiser)
        ranks = sharing(self.denoiser, self.ranks)
        free = _free(batch)
        mine = free[ranks.share(len(free))]
        denoiser = with_subject_mask(self.denoiser, whole.subject, mine)
        z0, anchor = _encoded(whole, self.denoiser, ranks)
        agree, share = _hooks(whole, settings, self.capabilities)
        noise = torch.randn(z0.shape, generator=generator, dtype=z0.dtype)
        start = levels_of(self.denoiser.schedule, settings)[0]
        x = add_noise(z0, settings.noise_scale * share(noise), start)
        condition = None
        if len(mine):
            condition = denoiser.condition(whole.originals[mine], batch.prompt, generator)
        sized = prepared(denoiser, x[mine], whole.originals[mine], batch.prompt, settings, ranks)
        counted = Counted(sized if ranks.size == 1 else Shared(sized, ranks))
        steps = sample(
            counted,
            condition,
            x,
            settings,
            consensus=agree,
            share=share,
            anchor=anchor,
            generator=generator,
        )
        for step in steps:
            x = step.x
            if step.step < step.steps:
                yield EditProgress(step.step, step.steps, evaluations=counted.evaluations)
        images = _completed(batch, ranks.rows(self.denoiser.decode, x[free]))
        yield EditProgress(settings.steps, settings.steps, images, counted.evaluations)


class _Around:
    """A predictor with the properties of another."""

    def __init__(self, predictor: Predictor) -> None:
        self._predictor = predictor

    @property
    def name(self) -> str:
        return self._predictor.name

    @property
    def schedule(self) -> Schedule:
        return self._predictor.schedule

    @property
    def predicts(self) -> Prediction:
        return self._predictor.predicts


class Counted(_Around):
    """A predictor that counts the evaluations of its network."""

    evaluations = 0
    """Views times conditions, summed over the calls."""

    def branches(
        self, x: Float[Tensor, "v c y x"], t: float, condition: Any, need: Need
    ) -> Branches:
        """Branches of the wrapped predictor, counted."""
        self.evaluations += len(x) * sum(need)
        return self._predictor.branches(x, t, condition, need)


class Shared(_Around):
    """A predictor whose views are shared out over ranks: each predicts its own from their
    condition, and all get all predictions."""

    def __init__(self, predictor: Predictor, ranks: Ranks) -> None:
        super().__init__(predictor)
        self._ranks = ranks

    def branches(
        self, x: Float[Tensor, "v c y x"], t: float, condition: Any, need: Need
    ) -> Branches:
        """The predictor's, of the views of all ranks; `condition` is of this rank's views."""

        def predict(mine: Float[Tensor, "n c y x"]) -> Float[Tensor, "n b c y x"]:
            predicted = self._predictor.branches(mine, t, condition, need)
            return torch.stack([branch for branch in predicted if branch is not None], 1)

        predicted = iter(self._ranks.rows(predict, x).unbind(1))
        return Branches(*(next(predicted) if needed else None for needed in need))


def sharing(denoiser: Denoiser, ranks: Ranks) -> Ranks:
    """The ranks among which views are shared out: `ALONE` unless the denoiser runs a network (it
    declares with_micro_batch). All ranks then do the same, in less time than a message takes."""
    return ranks if denoiser.capabilities.with_micro_batch else ALONE


def with_subject_mask(
    denoiser: Denoiser,
    subject: Float[Tensor, "v H W"] | None,
    views: Int[Tensor, " n"] | None = None,
) -> Denoiser:
    """The denoiser for these `views` (None: all), whose subject is in this mask.

    Itself where there is no mask, or the denoiser takes none.
    """
    with_subject = denoiser.capabilities.with_subject
    if subject is None or with_subject is None:
        return denoiser
    return with_subject(subject if views is None else subject[views])


def prepared(
    denoiser: Denoiser,
    x: Float[Tensor, "v c y x"],
    originals: Float[Tensor, "v h w 3"],
    prompt: str,
    settings: SamplerSettings,
    ranks: Ranks = ALONE,
) -> Predictor:
    """The denoiser with as many views in a pass as fit in memory, and in bfloat16 if that is exact
    enough (see gsedit.diffusion.precision).

    A denoiser that runs a network (with_micro_batch is declared) is measured on the first view:
    the memory of a pass and of a decoding, and the error of bfloat16. Others are left alone. Ranks
    of one machine share its memory, and all compute in the precision that rank 0 finds; a rank
    may have no view.
    """
    with_micro_batch = denoiser.capabilities.with_micro_batch
    if with_micro_batch is None:
        return denoiser
    if not len(x):
        return InBfloat16(denoiser) if ranks.first(False) else denoiser
    first = levels_of(denoiser.schedule, settings)[0]
    condition = denoiser.condition(originals[:1], prompt, torch.Generator())

    def guided(predictor: Predictor) -> Tensor:
        return predict_guided(predictor, condition, x[:1], first, settings)

    held = max(peak_bytes(lambda: guided(denoiser)), peak_bytes(lambda: denoiser.decode(x[:1])))
    chosen = with_precision(denoiser, guided, settings.precision)
    sized = with_micro_batch(views_at_once(len(x), held * ranks.local, settings.memory))
    return InBfloat16(sized) if ranks.first(chosen is not denoiser) else sized


def padded(batch: EditBatch, denoiser: Denoiser) -> EditBatch:
    """The batch with the sides that the denoiser wants; added cells are in no cluster."""
    images, originals = (
        pad_to_multiple(pictures, denoiser.multiple, denoiser.padding)
        for pictures in (batch.images, batch.originals)
    )
    subject = batch.subject
    if subject is not None:
        subject = pad_to_multiple(subject, denoiser.multiple, denoiser.padding)
    matches = batch.correspondences
    if matches is not None:
        labels = _padded_labels(matches.labels, batch.images, images, denoiser.cell)
        matches = replace(matches, labels=labels)
    return replace(
        batch, images=images, originals=originals, subject=subject, correspondences=matches
    )


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
    batch: EditBatch, denoiser: Denoiser, ranks: Ranks
) -> tuple[Float[Tensor, "v c y x"], Anchor | None]:
    """(clean latents, those of the anchored views as finished edits)."""
    z0 = ranks.rows(denoiser.encode, batch.images)
    anchored: Bool[Tensor, " v"] | None = batch.anchored
    if anchored is None or not anchored.any():
        return z0, None
    z0 = z0.clone()
    z0[anchored] = ranks.rows(
        lambda images, originals: denoiser.encode_edited(images, originals, batch.prompt),
        batch.images[anchored],
        batch.originals[anchored],
    )
    return z0, Anchor(anchored, z0)


def _hooks(
    batch: EditBatch, settings: SamplerSettings, capabilities: Capabilities
) -> tuple[Hook | None, Hook]:
    """(consensus, noise sharing) of a padded batch."""
    if batch.correspondences is None:
        return None, lambda noise: noise
    labels = batch.correspondences.labels
    agree = partial(
        consensus, labels=labels, anchored=batch.anchored, strength=settings.consensus_weight
    )
    coarse = capabilities.coarse
    if coarse is not None:
        agree = partial(_agree_coarsely, agree, coarse)
    if settings.noise == "independent":
        return agree, lambda noise: noise
    return agree, _SharedNoise(labels, torch.Generator().manual_seed(batch.seed))


def _agree_coarsely(
    agree: Hook, coarse: Hook, x: Float[Tensor, "v c y x"]
) -> Float[Tensor, "v c y x"]:
    return x + coarse(agree(x) - x)


@dataclass(frozen=True, eq=False)
class _SharedNoise:
    """Noise that views have in common, and with them all batches of an edit: one set of draws."""

    labels: Int[Tensor, "v y x"]
    common: torch.Generator

    def __call__(self, noise: Float[Tensor, "v c y x"]) -> Float[Tensor, "v c y x"]:
        first = torch.randn(noise[:1].shape, generator=self.common, dtype=noise.dtype)
        return share_noise(torch.cat((first, noise[1:])), self.labels)


def _check_shapes(batch: EditBatch) -> None:
    if batch.images.shape != batch.originals.shape:
        raise UsageError(
            f"images are {tuple(batch.images.shape)} and originals "
            f"{tuple(batch.originals.shape)}: an edit needs one original of the same size per view"
        )
    if not len(batch.images):
        raise UsageError("there is no view to edit: give at least one")
