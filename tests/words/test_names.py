"""Each name of the table that reader and painters share is read, and has a painter."""

from collections import Counter

import pytest
from sentence_grades import read_all

from gsedit.change.light.setup import LIGHTS
from gsedit.change.materials.material import MATERIALS
from gsedit.change.objects.growth.places import GROWTHS
from gsedit.change.scenery.effects import SCENERIES
from gsedit.words import lexicon

ELSEWHERE = {"turquoise", "snow"}  # a paint and a weather where nothing else is said


@pytest.mark.parametrize(
    ("names", "kind", "frame"),
    [
        (MATERIALS.keys() - ELSEWHERE, "material", "make it out of {}"),
        (LIGHTS, "light", "make it {}"),
        (SCENERIES, "look", "{}"),
        (GROWTHS, "growth", "put a layer of {} on it"),
    ],
    ids=["materials", "lights", "weathers", "growths"],
)
def test_each_name_is_read(names, kind, frame):
    names = list(names)
    for name, read in zip(names, read_all(frame.format(name) for name in names)):
        for change in read.changes:  # "wet" alone is no weather
            assert (change.kind, change.name) == (kind, name)
            assert change.route in ("material", "light", "scenery", "object")


def test_no_phrase_is_told_twice_of_one_kind():
    looks = [("look", name, row) for name, row in lexicon.phrases_of_styles().items()]
    rows = (*lexicon.rows(), *lexicon.rows_of(lexicon.ALIASES), *looks)
    alike = [("look" if k in ("scenery", "style") else k, row) for k, _, row in rows]
    told = Counter((kind, each) for kind, row in alike for each in row)
    assert max(told.values()) == 1, told.most_common(9)
