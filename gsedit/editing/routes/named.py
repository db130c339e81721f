"""Objects that the changes of an instruction name, found in a scene before anything is changed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from gsedit.editing.routes.objects import MADE, key_of
from gsedit.errors import UsageError
from gsedit.select.finder import Names
from gsedit.select.region import Region, everything
from gsedit.words.instruction import Change
from gsedit.words.phrases import CARRIERS, GROUNDS, IT, is_noun
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
    names: Names | None = None,
) -> dict[str, Region]:
    """Regions of a scene by `key_of` and by phrase; "subject" is that of "it".

    The subject is searched once, and only where it is needed. It is also what the first noun alone
    ("the bear") is taken for, if the names do not know it and nothing is put on it, as on a table,
    and every phrase without `find_named`.
    Raises as these two do, and UsageError for two nouns that nothing tells apart.
    """
    phrases, firsts = _phrases(changes), unknown_nouns(changes, names or Names())
    targets = {key_of(change) for change in changes} & {"scene", "subject", "background"}
    meant = phrases if find_named is None else taken_nouns(changes, names or Names())
    found = {"scene": everything(scene)} if "scene" in targets else {}
    if targets & {"subject", "background"} or IT in phrases or meant:
        subject = find_region(scene)
        found["subject"] = subject
        found["background"] = _others(subject)
        found |= {each: replace(subject, note=f"{each} ({subject.note})") for each in meant}
    for phrase in phrases:
        if phrase not in (IT, *meant) and find_named is not None:
            if phrase in firsts:
                raise _unknown(phrase)
            try:
                found[phrase] = find_named(scene, phrase)
            except UsageError as error:
                if any(each.phrase == phrase and each.route == "object" for each in changes):
                    raise
                raise UsageError(
                    f"{error}; a noun alone, as 'the bear', is the main subject"
                ) from error
    for change in changes:
        if (key := key_of(change)) not in found and change.target == "background":
            found[key] = _others(found[change.phrase])
    return found


def unknown_nouns(changes: Sequence[Change], names: Names) -> list[str]:
    """Nouns alone that no name is, but for those that something is put on, as on a table."""
    on = {change.place.of for change in changes if change.place and change.place.side == "on"}
    nouns = [each for each in _phrases(changes) if is_noun(each) and not names.knows(each)]
    return [each for each in nouns if each not in on & CARRIERS]


def taken_nouns(changes: Sequence[Change], names: Names) -> list[str]:
    """The noun that is taken for the main subject: the first unknown one, unless "it" is said."""
    return unknown_nouns(changes, names)[: IT not in _phrases(changes)]


def _unknown(phrase: str) -> UsageError:
    """The error for a noun beside the one that is the subject."""
    return UsageError(
        f"only a network knows what {phrase!r} is, beside the main subject: tell it by its color, "
        "size or place, as in 'the red one' or 'the largest'"
    )


def _others(region: Region) -> Region:
    how = f"not ({region.how})" if region.how else ""
    return Region(~region.inside, f"all but {region.note}", how, region.sure)


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
