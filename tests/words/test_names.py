"""Names that sentences are read by: each has a painter, and each painter a name."""

import pytest

from gsedit.change.light.table import LIGHTS
from gsedit.change.materials.table import MATERIALS
from gsedit.change.objects.growth.table import GROWTHS
from gsedit.change.scenery.table import SCENERIES
from gsedit.words import lexicon
from gsedit.words.read import read_instruction


@pytest.mark.parametrize(
    ("names", "painters", "kind", "frame"),
    [
        (lexicon.names("light"), LIGHTS, "light", "make it {}"),
        (lexicon.names("scenery"), SCENERIES, "look", "{}"),
        (lexicon.things("growth"), GROWTHS, "growth", "put a layer of {} on it"),
    ],
    ids=["lights", "weather", "growths"],
)
def test_each_name_of_a_sentence_has_a_painter_and_each_painter_a_name(
    names, painters, kind, frame
):
    assert set(names) == set(painters)
    assert lexicon.names("material") <= set(MATERIALS)  # others are shades of these
    for name in names:
        for change in read_instruction(frame.format(name)).changes:  # "wet" alone is no weather
            assert (change.kind, change.name) == (kind, name)
            assert change.route in ("light", "scenery", "object")
