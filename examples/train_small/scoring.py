"""How well an editor follows sentences whose answers are known. `n` pictures of `h w` pixels."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.diffusion import SamplerSettings
from gsedit.editors.protocol import EditBatch, Editor
from gsedit.measures.decibels import psnr_from_rmse, rmse_from_psnr
from gsedit.measures.metrics import psnr
from train_small.sources import Sources
from train_small.target_edits import TRUTHS, edited

UNEDITED = "unedited"
"""What an edit is nearest to that did nothing."""


class Case(NamedTuple):
    """Pictures to be edited with one sentence, which asks for these looks."""

    sources: Sources
    names: tuple[str, ...]
    prompt: str


class Score(NamedTuple):
    """How one picture came out."""

    names: tuple[str, ...]
    prompt: str
    nearest: tuple[str, ...]
    """The looks whose true edit is nearest: of all single looks and the unedited picture, and for
    a pair of every pair that shares one look with it."""
    gain: float
    """By how many dB it is nearer to its true edit than the unedited picture is."""
    error: float
    """RMSE to the true edit."""
    kept: float | None
    """PSNR to the unedited picture outside the subject, dB; None where all of it may change."""
    seconds: float = 0.0
    """That the edit took."""

    @property
    def right(self) -> bool:
        return self.nearest == self.names


class Summary(NamedTuple):
    """Of many scores."""

    count: int
    nearest: float
    """The share that came out nearest to what was asked."""
    gain: float
    """Mean, dB."""
    kept: float | None
    """Of the mean squared error, dB."""
    seconds: float
    """Mean."""


def score(
    editor: Editor, cases: Iterable[Case], settings: SamplerSettings, seed: int = 0
) -> Iterator[Score]:
    """Edit every case's pictures, each on its own, and compare.

    Pictures that the look would not change (no subject in sight, say) are left out.
    """
    generator = torch.Generator().manual_seed(seed)
    for case in cases:
        images = case.sources.image
        batch = EditBatch(images=images, originals=images, prompt=case.prompt, seed=seed)
        began = time.perf_counter()
        *_, last = editor.edit(batch, settings, generator)
        seconds = (time.perf_counter() - began) / len(images)
        assert last.images is not None
        for each in judge(case, last.images):
            yield each._replace(seconds=seconds)


def judge(case: Case, found: Float[Tensor, "n h w 3"]) -> Iterator[Score]:
    """A score for each picture that was made of the case's."""
    options: dict[tuple[str, ...], Tensor] = {(UNEDITED,): case.sources.image}
    asked = dict.fromkeys((*_others(case.names), case.names))  # each once
    options |= {names: edited(case.sources, names) for names in asked}
    for i, image in enumerate(found):
        if torch.equal(options[case.names][i], case.sources.image[i]):
            continue
        errors = {names: float((image - at[i]).square().mean()) for names, at in options.items()}
        truth, before = options[case.names][i], case.sources.image[i]
        kept = None
        if all(TRUTHS[name].scope == "subject" for name in case.names):
            outside = case.sources.subject[i, ..., 0] == 0
            kept = psnr(image, before, outside) if outside.any() else None
        yield Score(
            names=case.names,
            prompt=case.prompt,
            nearest=min(errors, key=lambda names: errors[names]),
            gain=psnr(image, truth) - psnr(before, truth),
            error=math.sqrt(errors[case.names]),
            kept=kept,
        )


def _others(names: tuple[str, ...]) -> Iterator[tuple[str, ...]]:
    """What else it might have been."""
    yield from ((name,) for name in TRUTHS)
    for i, name in enumerate(names if len(names) == 2 else ()):
        for other in TRUTHS:
            if TRUTHS[other].scope == TRUTHS[name].scope:
                yield (other, names[1]) if i == 0 else (names[0], other)


def summary(scores: Sequence[Score]) -> Summary:
    """Shares and means. Raises ValueError for no scores."""
    if not scores:
        raise ValueError("there are no scores to sum up")
    kept = [rmse_from_psnr(each.kept) ** 2 for each in scores if each.kept is not None]
    return Summary(
        len(scores),
        sum(each.right for each in scores) / len(scores),
        sum(each.gain for each in scores) / len(scores),
        psnr_from_rmse(math.sqrt(sum(kept) / len(kept))) if kept else None,
        sum(each.seconds for each in scores) / len(scores),
    )
