"""`gsedit measure`: points, sizes, and what is refused."""

import json

import pytest
from command_line import gsedit, one_line


def test_distances_and_areas_of_coordinates(scene):
    found = gsedit("measure", scene, "--at", "0,0,0", "--at", "3,4,0", "--json")
    record = json.loads(found.stdout.splitlines()[-1])
    assert record["distance"]["value"] == pytest.approx(5)
    assert record["distance"]["interval_95"] == pytest.approx([5, 5])
    assert "gsedit align" in found.stderr
    corners = [word for corner in ("0,0,1", "2,0,1", "2,2,1") for word in ("--at", corner)]
    assert "area: 2.000" in gsedit("measure", scene, *corners).stdout


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ((), "name points with --at"),
        (("--at", "0,0,0"), "--height"),
        (("--at", "0,0,0", "--at", "nowhere"), "give a view, a column and a row"),
        (("--at", "0,0,0", "--region", "auto"), "name points with --at"),
        (("--at", "1,1,1", "--at", "1,1,1"), "the two points are one"),
    ],
)
def test_what_cannot_be_measured_is_told_in_one_line(scene, words, message):
    *_, last = gsedit("measure", scene, *words).stderr.splitlines(keepends=True)
    assert message in last
    assert one_line(last)
    assert last.startswith("gsedit: ")
