"""Whether a scene has one main subject, where a sentence has a noun that nobody knows."""

from __future__ import annotations

from gsedit.errors import UsageError
from gsedit.select.phrase import gap, names
from gsedit.select.region import Region
from gsedit.select.segment import Segment, Segments
from gsedit.words.phrases import DEFINITE


class SeveralObjects(UsageError):
    """A noun may be any of several objects of a scene."""

    def __init__(self, message: str, segments: Segments) -> None:
        """Keep the segments, for a picture of their numbers."""
        super().__init__(message)
        self.segments = segments


def check_alone(noun: str, segments: Segments, subject: Region) -> None:
    """Raise SeveralObjects where the scene has objects comparable to the one that is the subject.

    That is one that stands out too, so that it was found as a part of the subject, is at least half
    as large, and is apart from it: neither carries it, as a pedestal, nor is carried by it, as a
    hat, nor touches it, as a sweater.
    """
    objects = segments.objects
    found = {row.number: subject.inside[segments.inside(row.number)] for row in objects}
    main = max(objects, key=lambda row: int(found[row.number].sum()), default=None)
    if main is None or not found[main.number].any():
        return
    rivals = [
        row
        for row in objects
        if row.number != main.number
        and row.size >= 0.5 * main.size  # large enough to be meant as well
        and found[row.number].float().mean() > 0.5
        and gap(row, main) > 0.06 * main.size  # boxes that do not touch
        and row.number not in _chain(main, segments)
        and main.number not in _chain(row, segments)
    ]  # fmt: skip
    if not rivals:
        return
    colors = [name.split(" object")[0] for name in names(segments)]
    first, *more = (
        f"'object {row.number}' ({colors[row.number]}, {_where(row)})"
        for row in (main, *rivals[:3])
    )
    bare = " ".join(word for word in noun.split() if word not in DEFINITE)
    raise SeveralObjects(
        f"{noun!r} may be any of {len(rivals) + 1} objects of the scene, as no main subject stands "
        f"out alone: say {', '.join(more)} or {first}, or give one the name with gsedit select "
        f"SCENE --phrase 'object N' --as {bare}",
        segments,
    )


def _where(row: Segment) -> str:
    """Side of the middle that an object is on, as the cameras see the place."""
    x, half = row.middle[0], 0.25 * row.size
    return "on the left" if x < -half else "on the right" if x > half else "in the middle"


def _chain(row: Segment, segments: Segments) -> list[int]:
    """The numbers of an object and of all that it stands on."""
    chain = [row.number]
    while (under := segments.rows[chain[-1]].stands_on) >= 0 and under not in chain:
        chain.append(under)
    return chain
