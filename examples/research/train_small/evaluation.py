"""Scores of an editor against the target edits. `n` pictures of `h w` pixels."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.diffusion.settings import SamplerSettings
from gsedit.editor_protocol import EditBatch, Editor
from gsedit.measures.decibels import psnr_from_rmse, rmse_from_psnr
from gsedit.measures.metrics import psnr
from research.train_small.sources import Sources
from research.train_small.target_edits import TARGET_EDITS, target_images

UNEDITED = "unedited"
"""Stands for the looks of the unedited picture in `Score.nearest`."""


class Case(NamedTuple):
    """Pictures to be edited with one prompt, which asks for these looks."""

    sources: Sources
    names: tuple[str, ...]
    prompt: str


class Score(NamedTuple):
    """Scores of one edited picture."""

    names: tuple[str, ...]
    prompt: str
    nearest: tuple[str, ...]
    """The looks whose target edit is nearest: of all single looks and the unedited picture, and for
    a pair also of every pair that shares one look with it."""
    gain: float
    """PSNR to the target edit, minus the unedited picture's; dB."""
    error: float
    """RMSE to the target edit."""
    kept: float | None
    """PSNR to the unedited picture outside the subject, dB; None where all of it may change."""
    seconds: float = 0.0
    """Seconds of the edit a picture."""

    @property
    def correct(self) -> bool:
        return self.nearest == self.names


class Summary(NamedTuple):
    """Means over many scores."""

    count: int
    nearest: float
    """Share of the pictures whose nearest target edit is that of the prompt."""
    gain: float
    """Mean gain in dB."""
    kept: float | None
    """PSNR of the mean squared error, dB."""
    seconds: float
    """Mean seconds a picture."""


def evaluate(
    editor: Editor, cases: Iterable[Case], settings: SamplerSettings, seed: int = 0
) -> Iterator[Score]:
    """Edit every case's pictures, each independently of the others, and score them.

    Pictures that the target edit does not change (without a subject, say) are left out.
    """
    generator = torch.Generator().manual_seed(seed)
    for case in cases:
        images = case.sources.image
        batch = EditBatch(images=images, originals=images, prompt=case.prompt, seed=seed)
        began = time.perf_counter()
        *_, last = editor.edit(batch, settings, generator)
        seconds = (time.perf_counter() - began) / len(images)
        assert last.images is not None
        for each in scores_of(case, last.images):
            yield each._replace(seconds=seconds)


def scores_of(case: Case, edited: Float[Tensor, "n h w 3"]) -> Iterator[Score]:
    """A score for each edited picture of the case."""
    unedited = case.sources.image
    candidates: dict[tuple[str, ...], Tensor] = {(UNEDITED,): unedited}
    looks = dict.fromkeys((*_other_looks(case.names), case.names))  # each once
    candidates |= {names: target_images(case.sources, names) for names in looks}
    for i, image in enumerate(edited):
        target, before = candidates[case.names][i], unedited[i]
        if torch.equal(target, before):
            continue
        errors = {names: float((image - c[i]).square().mean()) for names, c in candidates.items()}
        yield Score(
            names=case.names,
            prompt=case.prompt,
            nearest=min(errors, key=lambda names: errors[names]),
            gain=psnr(image, target) - psnr(before, target),
            error=math.sqrt(errors[case.names]),
            kept=_kept(case, i, image),
        )


def _kept(case: Case, i: int, image: Float[Tensor, "h w 3"]) -> float | None:
    """PSNR of the case's picture i to the unedited one, outside the subject."""
    if any(TARGET_EDITS[name].scope == "scene" for name in case.names):
        return None
    outside = case.sources.subject[i, ..., 0] == 0
    return psnr(image, case.sources.image[i], outside) if outside.any() else None


def _other_looks(names: tuple[str, ...]) -> Iterator[tuple[str, ...]]:
    """All single looks, and for a pair the pairs that share one look with it."""
    yield from ((name,) for name in TARGET_EDITS)
    for i, name in enumerate(names if len(names) == 2 else ()):
        for other in TARGET_EDITS:
            if TARGET_EDITS[other].scope == TARGET_EDITS[name].scope:
                yield (other, names[1]) if i == 0 else (names[0], other)


def summary(scores: Sequence[Score]) -> Summary:
    """Shares and means. Raises ValueError for no scores."""
    if not scores:
        raise ValueError("there are no scores to sum up")
    kept = [rmse_from_psnr(each.kept) ** 2 for each in scores if each.kept is not None]
    return Summary(
        len(scores),
        sum(each.correct for each in scores) / len(scores),
        sum(each.gain for each in scores) / len(scores),
        psnr_from_rmse(math.sqrt(sum(kept) / len(kept))) if kept else None,
        sum(each.seconds for each in scores) / len(scores),
    )
