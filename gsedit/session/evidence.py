"""Measure the result of an edit, and gather the pictures that show it."""

from __future__ import annotations

from collections.abc import Generator, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from jaxtyping import Float
from torch import Tensor

from gsedit.measures.agreement import COMPARED_VIEWS, Pictures, compare_renders, compare_targets
from gsedit.reports.events import Event
from gsedit.session.held_out import (
    SHOWN,
    HeldOutViews,
    edit_held_out,
    shown_views,
    unedited_views,
)
from gsedit.session.quality import EditQuality, Measurement, assess, has_ground_truth, measure
from gsedit.session.session import Session
from gsedit.views.dataset import View


@dataclass(frozen=True, eq=False)
class Evidence:
    """What an edit came to."""

    originals: tuple[View, ...]
    """Renders of the unedited scene at the edited views."""
    finals: tuple[View, ...]
    """Renders of the edited scene at the same views."""
    held_out: HeldOutViews
    quality: EditQuality
    final: Measurement
    """The number that the progress of the edit was measured by, over all of its views."""


def gather_evidence(session: Session) -> Generator[Event, None, Evidence]:
    """Render, ask the editor for held-out views, measure. Yields the editor's steps."""
    edited = tuple(session.edited.targets or session.surveyed.plan.views)
    asked = session.settings.held_out_edits
    shown = shown_views(session, max(SHOWN, asked))
    is_measured = has_ground_truth(session) or not session.region.is_all
    measured = session.measured if is_measured else ()
    needed = tuple(dict.fromkeys((*edited, *shown, *measured)))
    finals = dict(zip(needed, session.render(session.views[i].camera for i in needed)))
    answers = yield from edit_held_out(session, shown[:asked])
    compared = shown_views(session, COMPARED_VIEWS)
    targets = {i: view.image for i, view in session.edited.targets.items()}
    unedited = unedited_views(session)

    def rendered(views: Sequence[int]) -> Pictures:
        missing = [i for i in views if i not in finals]
        drawn = session.render(session.views[i].camera for i in missing)
        return {**finals, **dict(zip(missing, drawn))}

    warp = (
        *compare_targets(unedited, targets),
        *compare_renders(unedited, compared, session.held_out, rendered),
    )
    originals = {i: session.unedited_picture(i) for i in (*edited, *shown)}
    return Evidence(
        originals=_named(session, originals, edited),
        finals=_named(session, finals, edited),
        held_out=HeldOutViews(
            originals=_named(session, originals, shown),
            edited=_named(session, answers, answers),
            finals=_named(session, finals, shown),
        ),
        quality=assess(session, finals, answers, warp),
        final=measure(session, None, finals),
    )


def _named(
    session: Session, pictures: Mapping[int, Float[Tensor, "h w 3"]], indices: Iterable[int]
) -> tuple[View, ...]:
    return tuple(replace(session.views[i], image=pictures[i]) for i in indices)
