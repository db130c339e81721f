"""Names that sentences are read by: each has a painter, and each painter a name."""

from __future__ import annotations

import pytest

from gsedit.light.named import LIGHTS
from gsedit.materials.table import MATERIALS
from gsedit.objects.growth.table import GROWTHS
from gsedit.scenery.named import SCENERIES
from gsedit.words import lexicon
from gsedit.words.read import read_instruction


@pytest.mark.parametrize(
    ("names", "painters", "kind", "frame"),
    [
        (lexicon.materials(), MATERIALS, "material", "make the bear of {}"),
        (lexicon.names("light"), LIGHTS, "light", "make it {}"),
        (lexicon.names("scenery"), SCENERIES, "look", "make it {}"),
        (lexicon.things("growth"), GROWTHS, "growth", "put a layer of {} on it"),
    ],
    ids=["materials", "lights", "weather", "growths"],
)
def test_each_name_has_a_painter_and_each_painter_but_a_shade_a_name(names, painters, kind, frame):
    assert set(names) <= set(painters)
    assert kind == "material" or set(painters) == set(names)
    for name in names:
        (change,) = read_instruction(frame.format(name)).changes
        assert (change.kind, change.name in names) == (kind, True)
        assert change.route in ("material", "light", "scenery", "object")
