"""Parts of a scene that a sentence is about: found before anything changes, carried over changes.

`n` Gaussians before a change, `m` after.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool
from torch import Tensor

from gsedit.editing.plan import COPY, MADE, PICTURE, key_of
from gsedit.errors import UsageError
from gsedit.formats.files import open_scene
from gsedit.paper.editors.protocol import Editor, truth_of
from gsedit.scene.outcome import NEW, Outcome
from gsedit.select.finder import Finder, Names
from gsedit.select.phrase import gap, names
from gsedit.select.region import Region, everything
from gsedit.select.segment import Segment, Segments
from gsedit.words.instruction import Change, Instruction
from gsedit.words.phrases import CARRIERS, DEFINITE, GROUNDS, IT, is_noun
from gsedit.words.read import read_instruction

SUBJECT = "auto"
"""Value of the setting `region` that leaves the part to the sentence."""
ALL = ("scene", "shown")
"""Keys of flags that everything new is in."""


@dataclass(frozen=True, eq=False)
class Parts:
    """Parts that changes are about, by `key_of` and by phrase, in a scene between two changes."""

    found: Mapping[str, Region]
    """As they were found in the scene before all changes; a drawn one that only its pictures will
    tell is missing."""
    flags: Mapping[str, Bool[Tensor, " n"]]
    """Gaussians of the scene as it is now."""

    def now(self, key: str) -> Region | None:
        """The region of a part in the scene as it is now; None where it was not found."""
        found = self.found.get(key)
        return None if found is None else replace(found, inside=self.flags[key])

    def after(self, change: Change, outcome: Outcome) -> Parts:
        """The parts of the scene after a change: what was put in place of an object is background,
        what was copied or inserted has its own name."""
        new = outcome.origin == NEW
        rows = outcome.origin.clamp_min(0)
        filled = change.kind == "object" and change.name not in (COPY, "insert")
        flags = {
            key: torch.where(new, key in ALL or (key == "background" and filled), inside[rows])
            for key, inside in self.flags.items()
        }
        if change.name in (COPY, "insert"):
            flags[MADE if change.name == COPY else change.phrase] = new
        return replace(self, flags=flags)


def find_parts(
    steps: Sequence[Instruction],
    finder: Finder,
    editor: Editor | None = None,
    shown: Bool[Tensor, " n"] | None = None,
) -> Parts:
    """Find all that the steps of an edit are about, before anything is changed.

    The subject is searched once, and only where it is needed. `editor` draws a sentence that it
    got as it is; what is not `shown` (None: all is) may keep its old reflections.
    Raises UsageError for a phrase that names nothing, two nouns that nothing tells apart, a subject
    with rivals; InputError for a file to put in that is no scene.
    """
    scene, changes = finder.scene, named_changes(steps)
    for change in changes:
        if change.name == "insert":
            open_scene(change.phrase)  # before any work is done
    for noun in taken_nouns(changes, finder.names):
        check_alone(noun, finder.segments, finder.subject)
    found = _regions(changes, finder)
    for step in steps:
        whole = step.changes[0].route == PICTURE
        if whole and (region := editor_region(finder, editor, step.text)) is not None:
            found[PICTURE] = region
    flags = {key: region.inside for key, region in found.items()}
    flags["shown"] = torch.ones(len(scene), dtype=torch.bool) if shown is None else shown
    return Parts(found, flags)


def named_changes(steps: Sequence[Instruction]) -> list[Change]:
    """The changes whose part the sentence names: all but what a 2D editor gets as it is."""
    return [each for step in steps for each in step.changes if each.route != PICTURE]


def aimed_at(steps: Sequence[Instruction], region: str) -> tuple[Instruction, ...]:
    """Steps whose changes are of what a region holds, whatever the sentence calls it; all but it
    where they are of the background. Files that are put in, and copies, keep their names. The same
    steps where the region leaves the part to the sentence."""
    if region == SUBJECT:
        return tuple(steps)
    made = {MADE, *(c.phrase for step in steps for c in step.changes if c.name == "insert")}
    return tuple(
        replace(step, changes=tuple(_marked(each, made) for each in step.changes)) for step in steps
    )


def _marked(change: Change, made: set[str]) -> Change:
    if change.phrase in made or change.route == PICTURE:
        return change
    if change.target == "background" and change.route == "object":
        return replace(change, phrase="")
    return replace(change, phrase="", target="subject")


def assumed(steps: Sequence[Instruction], names: Names) -> tuple[str, ...]:
    """Remarks on nouns that nobody knows and that are taken for the main subject."""
    nouns = taken_nouns(named_changes(steps), names)
    return tuple(f"{noun!r} was taken for the main subject" for noun in nouns)


def _regions(changes: Sequence[Change], finder: Finder) -> dict[str, Region]:
    """Regions by `key_of` and by phrase; "subject" is that of "it", and of the first noun alone
    ("the bear") that the names do not know, if nothing is put on it, as on a table."""
    phrases, names = _phrases(changes), finder.names
    firsts, meant = unknown_nouns(changes, names), taken_nouns(changes, names)
    targets = {key_of(change) for change in changes} & {"scene", "subject", "background"}
    found = {"scene": everything(finder.scene)} if "scene" in targets else {}
    if targets & {"subject", "background"} or IT in phrases or meant:
        subject = finder.subject
        found["subject"] = subject
        found["background"] = _others(subject)
        found |= {each: replace(subject, note=f"{each} ({subject.note})") for each in meant}
    for phrase in phrases:
        if phrase in (IT, *meant):
            continue
        if phrase in firsts and any(phrase in each.keep for each in changes):
            raise UsageError(
                f"{phrase!r} must stay as it is, and only a network knows what that is: tell it by "
                "its color, size or place, as in 'but not the red one', or save it by a name with "
                "gsedit select ... --as NAME"
            )
        if phrase in firsts:
            raise UsageError(
                f"only a network knows what {phrase!r} is, beside the main subject: tell it by its "
                "color, size or place, as in 'the red one' or 'the largest'"
            )
        try:
            found[phrase] = finder.named(phrase)
        except UsageError as error:
            if any(each.phrase == phrase and each.route == "object" for each in changes):
                raise
            raise UsageError(
                f"{error}; a noun alone, as 'the bear', is the main subject"
            ) from error
    for change in changes:
        whole = key_of(replace(change, keep=()))
        if whole not in found and change.target == "background":
            found[whole] = _others(found[change.phrase])
        if change.keep:
            found[key_of(change)] = _without(found[whole], change, found)
    return found


def _without(region: Region, change: Change, found: Mapping[str, Region]) -> Region:
    """A region without what a change keeps. Raises UsageError where nothing of it is left."""
    inside = region.inside
    for phrase in change.keep:
        inside = inside & ~found["subject" if phrase == IT else phrase].inside
    if not inside.any():
        raise UsageError(
            f"{change}: nothing is left of it without {' and '.join(change.keep)}: point at what "
            "changes with --at VIEW:X,Y"
        )
    return Region(inside, f"{region.note}, but not {' and '.join(change.keep)}", "", region.sure)


def unknown_nouns(changes: Sequence[Change], names: Names) -> list[str]:
    """Nouns alone that no name is. A table that only changes its looks is none of them: it is found
    by what it carries, and what is on it goes along only where it goes."""
    on = {change.place.of for change in changes if change.place and change.place.side == "on"}
    goes = {change.phrase for change in changes if change.route == "object"} - on
    nouns = [each for each in _phrases(changes) if is_noun(each) and not names.knows(each)]
    return [each for each in nouns if each not in CARRIERS or each in goes]


def taken_nouns(changes: Sequence[Change], names: Names) -> list[str]:
    """The noun that is taken for the main subject: the first unknown one, unless "it" is said."""
    said = IT in _phrases(changes) or any(
        each.target == "subject" and not each.phrase for each in changes
    )
    return unknown_nouns(changes, names)[: not said]


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
        named += [] if key_of(replace(change, keep=())) == "background" else [change.phrase]
        grounded = change.name == "insert" and place and place.of in GROUNDS
        named += [place.of] if place and not grounded else []
        named += change.keep
    return [phrase for phrase in dict.fromkeys(named) if phrase not in made]


def editor_region(finder: Finder, editor: Editor | None, sentence: str) -> Region | None:
    """The region that a drawn edit may change: that of the finder, or everything where `auto` finds
    that a sentence is about the whole scene; None where only the editor's pictures will tell."""
    whole = is_whole(editor, sentence) if sentence else False
    if finder.region != SUBJECT or whole is False:
        return finder.subject
    if whole is None:
        return None
    note = "auto: the instruction is about the whole scene"
    return Region(everything(finder.scene).inside, note)


def is_whole(editor: Editor | None, sentence: str) -> bool | None:
    """Whether a sentence is about the whole scene, and not its subject alone; None where it does
    not say. Editors with a known ground truth edit whole pictures."""
    if truth_of(editor) is not None:
        return True
    targets = {change.target for change in read_instruction(sentence).changes}
    if "background" in targets or not targets:
        return None
    return "scene" in targets


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
