"""What is measured: while an edit goes on, and of its result."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor

from gsedit.measures.agreement import Pictures, WarpComparison
from gsedit.measures.decibels import psnr_from_rmse, rmse_from_psnr
from gsedit.measures.metrics import (
    INSIDE,
    NEAREST,
    edit_strength,
    perceptual,
    pooled_rmse,
    psnr,
    squared_error,
    ssim,
)
from gsedit.reports.events import Event
from gsedit.session.session import Session
from gsedit.views.dataset import evenly_spaced

PROGRESS_VIEWS = 3
"""Views that are measured while the work goes on, and by the perceptual distance; all are at the
end."""


@dataclass(frozen=True)
class EditQuality:
    """What edit.json has under "measured": a new metric is a field here and a line in `assess`.

    The perceptual distances (`metrics.perceptual`) are means over up to three views, None without
    the extra `perceptual`.
    """

    matched: float | None
    """Mean fraction of latent cells matched between two views of a batch; None without any two."""
    pairs: tuple[tuple[str, str, float], ...]
    """(view, view, matched fraction) of every two views that were in a batch together."""
    coverage: float
    """Share of what all views see that the planned views show well, in [0, 1]."""
    strength: float
    """RMSE between renders of the unedited and of the edited scene: 0 is no edit at all."""
    residual_to_targets_db: float | None
    """Mean PSNR of the final renders against the edited 2D pictures that the scene was fitted to,
    dB: how far the scene follows them, not how good they are. None where a strategy edits none."""
    psnr_to_ground_truth: float | None
    """Mean PSNR to the true edit at the held-out cameras, dB; None where it is unknown."""
    leakage: float | None = None
    """RMSE between renders of the unedited and of the edited scene outside the region (pixels of
    which it is less than half), at the edited views; None where the region is everything."""
    kept: float | None = None
    """PSNR of the same pixels at the held-out cameras, dB; None too where no view is held out."""
    warp: tuple[WarpComparison, ...] = ()
    """How far the targets and the final renders agree between views, beside the unedited scene."""
    psnr_to_held_out_edits: float | None = None
    """Mean PSNR of the final renders against what the 2D editor makes of held-out views, dB: the
    scene was not fitted to them. None where the editor was not asked."""
    perceptual_strength: float | None = None
    """Perceptual distance between renders of the unedited and of the edited scene."""
    perceptual_to_ground_truth: float | None = None
    """Perceptual distance to the true edit at held-out cameras."""
    perceptual_to_held_out_edits: float | None = None
    """Perceptual distance to what the 2D editor makes of held-out views."""
    perceptual_to_targets: float | None = None
    """Perceptual distance to the edited 2D pictures that the scene was fitted to."""
    ssim_to_targets: float | None = None
    """Mean SSIM of the final renders and the edited 2D pictures that the scene was fitted to."""
    ssim_to_held_out_edits: float | None = None
    """Mean SSIM of the final renders and what the 2D editor makes of held-out views."""

    def describe(self) -> str:
        """The numbers to read first, on one line."""
        parts = [f"strength {self.strength:.3f} (0 is no edit)"]
        parts += [
            f"{row.pictures} differ between near views by {row.edited:.3f}, unedited renders by "
            f"{row.unedited:.3f}"
            for row in self.warp
            if row.range == "short"
        ]
        if self.psnr_to_held_out_edits is not None:
            parts.append(f"{self.psnr_to_held_out_edits:.1f} dB to edits of held-out views")
        if self.kept is not None and self.leakage is not None:
            parts.append(
                f"outside the region kept to {self.kept:.1f} dB at held-out views, "
                f"leakage {self.leakage:.4f}"
            )
        return "; ".join(parts)


@dataclass(frozen=True)
class Measurement:
    """Mean PSNR of the scene's renders, and what they were compared with."""

    decibels: float | None
    """None where there is nothing to compare with."""
    against: str

    def event(
        self, stage: str, seconds: float, step: int = 0, steps: int = 0, loss: float | None = None
    ) -> Event:
        """The measurement as an event of that stage."""
        if self.decibels is None:
            return Event(stage, seconds, step, steps, loss)
        note = f"{self.decibels:.2f} dB to the {self.against}"
        return Event(stage, seconds, step, steps, loss, rmse_from_psnr(self.decibels), note)


def measure(
    session: Session, views: int | None = PROGRESS_VIEWS, finals: Pictures | None = None
) -> Measurement:
    """The scene as it is now, at `views` evenly spaced views (None: all).

    Against the ground truth at held-out cameras where it is known, otherwise against the targets:
    how far the scene follows them, not how good they are. `finals` are renders that exist already.
    """
    finals = finals or {}
    expected = _ground_truth(session, views)
    against = f"ground truth at {len(expected)} held-out cameras"
    if not expected:
        targets = session.edited.targets
        expected = {i: targets[i].image for i in _evenly(tuple(targets), views)}
        against = "targets it is fitted to (residual)"
    if not expected:
        return Measurement(None, "nothing")
    missing = [i for i in expected if i not in finals]
    drawn = {i: session.preview(i) for i in missing}
    return Measurement(_mean_psnr({**finals, **drawn}, expected), against)


def has_ground_truth(session: Session) -> bool:
    """Whether the true edit of held-out views is known."""
    return session.edited.ground_truth is not None and bool(session.held_out)


def assess(
    session: Session,
    finals: Pictures,
    held_out_edits: Pictures,
    warp: tuple[WarpComparison, ...],
) -> EditQuality:
    """Of the result.

    `finals` are renders of the edited scene at the edited views, at the views of `held_out_edits`
    (what the 2D editor makes of them), and at all held-out views if there is a ground truth, or the
    region is not everything.
    """
    edited = session.edited
    targets = {i: view.image for i, view in edited.targets.items()}
    shown = tuple(targets or session.surveyed.plan.views)
    originals = {i: session.unedited_picture(i) for i in shown}
    truth = _ground_truth(session, None)
    leakage, left = (_change_outside(session, finals, views) for views in (shown, session.measured))
    return EditQuality(
        matched=mean(share for *_, share in edited.pairs) if edited.pairs else None,
        pairs=tuple(edited.pairs),
        coverage=session.surveyed.plan.coverage[-1],
        strength=mean(edit_strength(originals[i], finals[i]) for i in shown),
        residual_to_targets_db=_mean_psnr(finals, targets),
        psnr_to_ground_truth=_mean_psnr(finals, truth),
        leakage=leakage,
        kept=None if left is None else min(psnr_from_rmse(left), NEAREST),
        warp=warp,
        psnr_to_held_out_edits=_mean_psnr(finals, held_out_edits),
        perceptual_strength=_mean_perceptual(finals, originals),
        perceptual_to_ground_truth=_mean_perceptual(finals, truth),
        perceptual_to_held_out_edits=_mean_perceptual(finals, held_out_edits),
        perceptual_to_targets=_mean_perceptual(finals, targets),
        ssim_to_targets=_mean_ssim(finals, targets),
        ssim_to_held_out_edits=_mean_ssim(finals, held_out_edits),
    )


def _ground_truth(session: Session, views: int | None) -> dict[int, Float[Tensor, "h w 3"]]:
    """The true edit at that many held-out views (None: all); nothing where it is unknown."""
    truth = session.edited.ground_truth
    if truth is None:
        return {}
    chosen = _evenly(session.measured, views)
    unedited = {i: session.unedited_picture(i) for i in chosen}
    return {i: session.within_region(i, truth(image[None])[0]) for i, image in unedited.items()}


def _change_outside(session: Session, finals: Pictures, views: Iterable[int]) -> float | None:
    """RMSE between unedited and final renders, over all pixels of which the region is less than
    half; None where there are none."""
    if session.region.is_all:
        return None
    return pooled_rmse(
        squared_error(
            session.unedited_picture(i),
            finals[i],
            session.coverage(i) < INSIDE,
        )
        for i in views
    )


def _evenly(indices: tuple[int, ...], number: int | None) -> list[int]:
    if number is None or not indices:
        return list(indices)
    return [indices[i] for i in evenly_spaced(len(indices), number)]


def _mean_psnr(finals: Pictures, expected: Pictures) -> float | None:
    """None where nothing is expected."""
    return mean(psnr(finals[i], image) for i, image in expected.items()) if expected else None


def _mean_ssim(finals: Pictures, expected: Pictures) -> float | None:
    """None where nothing is expected."""
    return mean(ssim(finals[i], image) for i, image in expected.items()) if expected else None


def _mean_perceptual(finals: Pictures, expected: Pictures) -> float | None:
    """Over PROGRESS_VIEWS of the expected pictures; None where there are none, or no weights."""
    chosen = _evenly(tuple(expected), PROGRESS_VIEWS)
    distances = [perceptual(finals[i], expected[i]) for i in chosen]
    known = [distance for distance in distances if distance is not None]
    return mean(known) if known else None


def mean(values: Iterable[float]) -> float:
    """Of one number or more."""
    numbers = [float(value) for value in values]
    return sum(numbers) / len(numbers)
