"""Templates of exceptions over things, materials, tones and looks: what stays never changes."""

from __future__ import annotations

import pytest
from sentence_grades import read_all

from gsedit.words.instruction import Change
from gsedit.words.lexicon import TABLE, looks, rows_of, styles
from gsedit.words.read import read_instruction

NOUNS = sorted(
    each
    for kind, _, phrases in rows_of(TABLE)
    if kind in ("subject", "part")
    for each in phrases
    if " " not in each and len(each) > 2 and each != "foreground"
)
LOOKS = [*looks()["material"][::20], *list(styles())[::9], "snow", "night", "sepia"]
PARTS = ("nose", "eyes", "ears", "hair", "handle", "lid", "wheels", "roof", "tail", "face")


def leaves(change: Change, kept: str) -> bool:
    """Whether a change plainly leaves out what stays."""
    out = [*change.keep, *([change.phrase] if change.target == "background" else [])]
    return any(kept in each for each in out)


@pytest.mark.parametrize(
    "frame",
    ["{}, keep the {}", "{} but keep the {}", "{} but not the {}", "{}, leave the {} alone",
     "{} without touching the {}", "{}, the {} stays as it is", "{}, except the {}"],
)  # fmt: skip
@pytest.mark.parametrize(
    "change", ["make the {} gold", "paint the {} red", "turn the {} into glass",
               "make the {} darker", "cover the {} with moss"],
)  # fmt: skip
def test_of_two_things_one_changes_and_one_stays(change, frame):
    pairs = [*zip(NOUNS[::30], NOUNS[1::30]), ("vase", "table"), ("car", "house")]
    some = read_all(frame.format(change.format(changed), kept) for changed, kept in pairs)
    for (changed, kept), read in zip(pairs, some):
        for each in read.changes:
            assert changed in each.phrase, read
            assert each.target == "subject"
            assert leaves(each, kept), read


@pytest.mark.parametrize(
    "frame",
    ["everything {look} but the {}", "make everything {look} but the {}",
     "everything but the {} {look}", "make all {look} except the {}",
     "everything in {look} except for the {}", "turn everything {look}, not the {}",
     "all but the {} in {look}", "make it all {look} but not the {}"],
)  # fmt: skip
def test_everything_but_a_thing_leaves_it_out(frame):
    pairs = [(a, look) for at, a in enumerate(NOUNS[::40]) for look in LOOKS[at % 2 :: 2]]
    some = read_all(frame.format(noun, look=look) for noun, look in pairs)
    for (noun, _), read in zip(pairs, some):
        assert all(leaves(each, noun) for each in read.changes), read


@pytest.mark.parametrize(
    "frame",
    ["make the bear {} but not its {}", "the bear in {} but its {} stays",
     "turn the bear {}, leave its {} alone", "make it {} but not the {}"],
)  # fmt: skip
def test_a_part_that_stays_is_left_out(frame):
    pairs = [(part, look) for at, part in enumerate(PARTS) for look in LOOKS[at % 3 :: 3]]
    some = read_all(frame.format(look, part) for part, look in pairs)
    for (part, _), read in zip(pairs, some):
        assert all(leaves(each, part) for each in read.changes), read


@pytest.mark.parametrize("known", ["warmer", "darker", "night", "gold", "red"])
@pytest.mark.parametrize("other", ["export it as mp4", "add a hat"])
def test_what_is_not_read_stops_the_rest_and_is_told(known, other):
    read = read_instruction(f"make it {known} and {other}")
    assert not read.known


@pytest.mark.parametrize(
    "request_", ["remove the vase", "make the bear gold", "make it darker", "make it night"]
)
@pytest.mark.parametrize(
    "remark",
    ["It looks terrible.", "I can't see a thing.", "It is ugly.", "My eyes aren't what they were.",
     "It isn't nice.", "I don't like it.", "It hurts my eyes.", "That would be great."],
)  # fmt: skip
def test_a_remark_beside_a_request_changes_nothing(request_, remark):
    told = read_instruction(f"{request_}. {remark}")
    assert told.changes in ((), read_instruction(request_).changes), told
