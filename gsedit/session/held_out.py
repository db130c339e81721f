"""The held-out views of an edit: what the 2D editor makes of them, beside the edited scene."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass
from itertools import chain

from jaxtyping import Float
from torch import Tensor

from gsedit.measures.agreement import UneditedViews, spread
from gsedit.reports.events import Event
from gsedit.session.edit_views import ANCHORS, MEASURE, match_views, sample_views
from gsedit.session.session import Session
from gsedit.views.dataset import View

SHOWN = 2
"""Held-out views in before_after.png."""


@dataclass(frozen=True, eq=False)
class HeldOutViews:
    """Some held-out cameras, three times; the scene was fitted to none of these pictures."""

    originals: tuple[View, ...] = ()
    """Renders of the unedited scene."""
    edited: tuple[View, ...] = ()
    """What the 2D editor makes of them, of the first ones at least; none where it was not asked."""
    finals: tuple[View, ...] = ()
    """Renders of the edited scene."""


def shown_views(session: Session, number: int) -> tuple[int, ...]:
    """`number` evenly spaced held-out views, those in the middle of equal parts."""
    return spread(session.held_out, number)


def unedited_views(session: Session) -> UneditedViews:
    """The scene before the edit at all views, to compare views with each other."""
    return UneditedViews([view.camera for view in session.views], session.unedited_rendering)


def edit_held_out(
    session: Session, views: tuple[int, ...]
) -> Generator[Event, None, dict[int, Float[Tensor, "h w 3"]]]:
    """Ask the editor for these held-out views as it was asked for the targets, tied to them by
    anchors and the noise that all batches share.

    Nothing where that has no meaning: the editor is no diffusion model, so it has no noise to
    share, or no view was edited. Sampling starts from the unedited scene: what the editor makes
    of them must not depend on what is measured.
    """
    answers, editor = session.edited.answers, session.request.editor
    if not views or not answers or editor.capabilities.denoiser is None:
        return {}
    unedited = unedited_views(session)
    near = zip(*(unedited.nearest(view, answers) for view in views))  # in turn, a view at a time
    anchors = tuple(dict.fromkeys(chain.from_iterable(near)))[:ANCHORS]
    members = (*views, *anchors)
    images = yield from sample_views(
        session,
        members,
        anchors,
        match_views(session, members),
        session.settings.sampler,
        start={i: session.unedited_picture(i) for i in views},
        stage=MEASURE,
    )
    return {i: session.within_region(i, image) for i, image in zip(views, images)}
