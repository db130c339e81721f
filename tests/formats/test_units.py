"""Units and frames through every format that is written and read."""

from importlib.util import find_spec

import numpy as np
import pytest
from point_clouds import ball

from gsedit.formats import registry as formats
from gsedit.formats.files import lost, open_scene, writable_format, write_scene
from gsedit.formats.streams import SceneHeader
from gsedit.scene.table import table_of


@pytest.mark.parametrize("suffix", sorted({*formats.WRITABLE} & {*formats.READABLE} - {".usd"}))
def test_units_and_frame_survive_or_are_named_as_lost(suffix, tmp_path):
    """docs/reference/formats.md says which formats keep them."""
    if suffix in formats.USD and find_spec("pxr") is None:
        pytest.skip("needs usd-core (gsedit[usd])")
    told = ("metersPerUnit 0.01", "upAxis Z", "epsg 25832", "offset 691000 5335000 510")
    path, table = tmp_path / f"a{suffix}", table_of(ball(50))
    header = SceneHeader(table.degree, comments=told, antialiased=True)
    write_scene(path, header, iter((table,)))
    again = open_scene(path).header
    named = " ".join(lost(header, writable_format(path)))
    for text in told:
        assert (text in again.comments) != (text in named)
    assert again.antialiased != ("antialiased" in named)
    places = open_scene(path).table().means  # of a scale of its own in no format
    assert np.ptp(places, axis=0) == pytest.approx(np.ptp(table.means, axis=0), rel=0.01)
