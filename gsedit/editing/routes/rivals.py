"""Whether a scene has one main subject, where a sentence has a noun that nobody knows."""

from __future__ import annotations

from gsedit.errors import UsageError
from gsedit.regions.region import Region
from gsedit.selecting.looks import names
from gsedit.selecting.segment import Segment, Segments
from gsedit.words.phrases import DEFINITE

COMPARABLE = 0.5
"""Share of the main object's pixels, or size, from which another one could be meant as well."""
LISTED = 4
"""Most objects that the message lists."""


def check_alone(noun: str, segments: Segments, subject: Region) -> None:
    """Raise UsageError where the scene has objects comparable to the one that is the subject.

    That is one that fills at least half as many pixels, or that was found as a part of the subject
    and is at least half as large; and that neither carries it, as a pedestal, nor is carried by it,
    as a hat.
    """
    objects = segments.objects
    found = {row.number: subject.inside[segments.inside(row.number)] for row in objects}
    main = max(objects, key=lambda row: int(found[row.number].sum()), default=None)
    if main is None or not found[main.number].any():
        return
    rivals = [
        row
        for row in objects
        if (row.pixels >= COMPARABLE * main.pixels
            or (row.size >= COMPARABLE * main.size and found[row.number].float().mean() > 0.5))
        and row.number not in _chain(main, segments)
        and main.number not in _chain(row, segments)
    ]  # fmt: skip
    if not rivals:
        return
    told = names(segments)
    first, *more = (f"'the {told[row.number]} one'" for row in (main, *rivals[: LISTED - 1]))
    bare = " ".join(word for word in noun.split() if word not in DEFINITE)
    raise UsageError(
        f"{noun!r} may be any of {len(rivals) + 1} objects of the scene, as no main subject stands "
        f"out: say {', '.join(more)} or {first}, 'it' for the one nearest to a subject, or give "
        f"it the name with gsedit select ... --as {bare}"
    )


def _chain(row: Segment, segments: Segments) -> list[int]:
    """The numbers of an object and of all that it stands on."""
    chain = [row.number]
    while (under := segments.rows[chain[-1]].stands_on) >= 0 and under not in chain:
        chain.append(under)
    return chain
