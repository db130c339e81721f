"""Objects that the changes of an instruction name, found in a scene before anything is changed."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from gsedit.editing.routes.objects import MADE, key_of
from gsedit.errors import UsageError
from gsedit.regions.region import Region, everything
from gsedit.words.instruction import Change
from gsedit.words.phrases import GROUNDS, IT, is_noun
from rasterizer.scene import Gaussians

FindRegion = Callable[[Gaussians], Region]
"""Finds the subject of a scene."""
FindNamed = Callable[[Gaussians, str], Region]
"""Finds what a phrase names in a scene."""


def regions_of(
    scene: Gaussians,
    changes: Sequence[Change],
    find_region: FindRegion,
    find_named: FindNamed | None = None,
    *,
    knows_nouns: bool = False,
) -> dict[str, Region]:
    """Regions of a scene by `key_of` and by phrase; "subject" is that of "it".

    The subject is searched once, and only where it is needed. It is also what a noun alone names
    ("the bear"), if `find_named` does not know nouns, and what every phrase does without
    `find_named`. Raises as these two do, and UsageError for two nouns that nothing tells apart.
    """
    phrases = _phrases(changes)
    targets = {key_of(change) for change in changes} & {"scene", "subject", "background"}
    nouns = [] if knows_nouns else [each for each in phrases if is_noun(each)]
    meant = phrases if find_named is None else nouns[: IT not in phrases]
    found = {"scene": everything(scene)} if "scene" in targets else {}
    if targets & {"subject", "background"} or IT in phrases or meant:
        subject = find_region(scene)
        found["subject"] = subject
        found["background"] = _others(subject)
        found |= {each: Region(subject.inside, f"{each} ({subject.note})") for each in meant}
    for phrase in phrases:
        if phrase not in (IT, *meant) and find_named is not None:
            found[phrase] = find_named(scene, _told(phrase, nouns, changes))
    for change in changes:
        if (key := key_of(change)) not in found and change.target == "background":
            found[key] = _others(found[change.phrase])
    return found


def _told(phrase: str, nouns: Sequence[str], changes: Sequence[Change]) -> str:
    """A phrase in words that need no network: what a thing is put on is what carries it.

    Raises UsageError for a noun beside the one that is the subject.
    """
    if phrase not in nouns:
        return phrase
    for change in changes:
        place = change.place
        if change.name == "move" and place and (place.of, place.side) == (phrase, "on"):
            return f"the thing under {change.phrase}"
    raise UsageError(
        f"only a network knows what {phrase!r} is, beside the main subject: tell it by its color, "
        "size or place, as in 'the red one' or 'the largest'"
    )


def _others(region: Region) -> Region:
    return Region(~region.inside, f"all but {region.note}")


def _phrases(changes: Sequence[Change]) -> list[str]:
    """Phrases for which something must be found: not what a change puts in or copies, nor the
    ground that a file is put on."""
    made = {MADE, "", *(change.phrase for change in changes if change.name == "insert")}
    named = list[str]()
    for change in changes:
        place = change.place
        named += [] if key_of(change) == "background" else [change.phrase]
        grounded = change.name == "insert" and place and place.of in GROUNDS
        named += [place.of] if place and not grounded else []
    return [phrase for phrase in dict.fromkeys(named) if phrase not in made]
