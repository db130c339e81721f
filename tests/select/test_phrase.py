"""Phrases about things without a network: what they mean on staged scenes, and what is refused."""

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import pytest
import torch
from bench.staged import stage
from playroom import playroom

from gsedit.errors import UsageError
from gsedit.select import find_phrase, segment
from gsedit.select.phrase import names
from gsedit.select.query import read_phrase

PHRASES = Path(__file__).parents[1] / "data" / "phrases"
REFUSED = "refused"


def rows(file):
    """(stage, phrase, names of what it means) of each line."""
    for line in (PHRASES / file).read_text().splitlines():
        if line and not line.startswith("#"):
            where, _, rest = line.partition(": ")
            phrase, _, meant = rest.rpartition(" = ")
            yield where, phrase, meant.split(", ")


@lru_cache(8)
def staged(name):
    made = stage(name)
    labelled, cameras = made.gaussians(8000 if name == "table" else 3000), made.training(96)
    return labelled, segment(labelled.scene, cameras)


def outcome(where, phrase):
    """The flags of what a phrase is found to mean; None where it is refused."""
    labelled, segments = staged(where)
    try:
        return find_phrase(phrase, labelled.scene, segments=segments).inside
    except UsageError:
        return None


def is_right(where, phrase, meant):
    found = outcome(where, phrase)
    if meant == [REFUSED] or found is None:
        return found is None and meant == [REFUSED]
    true = staged(where)[0].of(*meant)
    return float((found & true).sum() / (found | true).sum()) > 0.8


@pytest.mark.parametrize("file", ["staged.txt", "aside.txt"])
def test_phrases_mean_the_right_things(file):
    wrong = [row for row in rows(file) if not is_right(*row)]
    assert len(wrong) <= 0.15 * len(list(rows(file))), wrong


def test_what_cannot_be_known_is_refused():
    unknown = [row for row in rows("staged.txt") if row[2] == [REFUSED]]
    assert unknown
    assert all(outcome(where, phrase) is None for where, phrase, _ in unknown)


@pytest.fixture(scope="module")
def room():
    made = playroom()
    return made, segment(made.scene, made.cameras)


def test_every_gaussian_is_of_one_segment_with_a_name_of_its_own(room):
    made, segments = room
    assert len(segments.labels) == len(made.scene)
    assert {int(i) for i in segments.labels.unique()} == {row.number for row in segments.rows}
    assert len(set(names(segments))) == len(segments.rows)


def test_what_stands_on_what_is_known(room):
    made, segments = room
    label = {n: int(segments.labels[made.of(n)].mode().values) for n in ("white box", "blue block")}
    assert segments.rows[label["blue block"]].stands_on == label["white box"]
    assert segments.rows[segments.rows[label["white box"]].stands_on].kind == "ground"


def test_each_name_means_its_segment(room):
    made, segments = room
    for row, name in zip(segments.rows, names(segments)):
        found = find_phrase(f"the {name}", made.scene, segments=segments)
        assert torch.equal(found.inside, segments.inside(row.number))


def test_a_refusal_names_the_candidates(room):
    made, segments = room
    with pytest.raises(UsageError, match=r"the red one.*--objects"):
        find_phrase("the dragon", made.scene, segments=segments)
    with pytest.raises(UsageError, match="several are like that: say which"):
        find_phrase("the one beside the yellow one on the ground", made.scene, segments=segments)


def test_an_unknown_noun_is_the_subject_where_that_is_known(room):
    made, segments = room
    ball = made.of("red ball")
    found = find_phrase("the dragon", made.scene, segments=segments, subject=lambda: ball)
    assert torch.equal(found.inside, segments.inside(int(segments.labels[ball].mode().values)))
    assert "dragon" in found.note


@pytest.mark.parametrize("phrase", ["", "!?", "everything"])
def test_nothing_and_everything_are_refused(room, phrase):
    with pytest.raises(UsageError):
        find_phrase(phrase, room[0].scene, segments=room[1])


def test_lists_are_read_as_several_things_but_not_within_a_relation():
    assert len(read_phrase("the red one and the blue one")) == 2
    (between,) = read_phrase("the one between the red one and the blue one")
    assert [len(ends) for _, ends in between.relations] == [2]
    (striped,) = read_phrase("the red and white ball")
    assert len(striped.colors) == 2


@pytest.mark.parametrize("flat", [(1, 1, 1), (1, 1, 0), (0, 0, 0)])
@pytest.mark.parametrize("count", [1, 2, 200])
def test_scenes_without_things_are_segmented_too(room, count, flat):
    scene = room[0].scene[:count]
    scene = replace(scene, means=scene.means * torch.tensor(flat))
    segments = segment(scene, room[0].cameras)
    assert len(segments.labels) == count
    assert segments.rows
