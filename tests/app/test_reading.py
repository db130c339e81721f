"""A sentence as the page tells it while it is typed."""

import pytest

from gsedit.app.reading import USUAL_COUNT, read
from gsedit.app.wording import on_page
from gsedit.capture.causes import Evidence, cause


def test_a_reading_tells_part_color_way_and_seconds():
    told = read("paint the bear glossy red").html(USUAL_COUNT)
    for part in ("the subject painted glossy red", "#e50000", "colors", "about"):
        assert part in told
    assert "the selection painted" in read("paint it red").html(USUAL_COUNT, selected=True)


def test_two_changes_take_longer_than_one_and_a_large_scene_longer_than_a_small_one():
    one, two = read("paint it red"), read("paint it red and make it night")
    assert len(two.instruction.changes) == 2
    assert two.seconds(USUAL_COUNT) > one.seconds(USUAL_COUNT) > one.seconds(USUAL_COUNT // 5)


@pytest.mark.parametrize("text", ["asdf qwer", "turn it into a van gogh painting", "undo", "<b>"])
def test_what_is_refused_tells_why_and_nothing_is_html(text):
    reading = read(text)
    assert reading.refusal
    assert reading.first is None
    assert "<b>" not in reading.html(10)


def test_names_of_saved_selections_are_heard():
    told = read("paint the left pot gold", ["left pot"])
    assert [each.phrase for each in told.instruction.changes] == ["the left pot"]


def before_map():
    features = {"a": 900, "b": 900}
    return cause(Evidence(features, [{"names": ("a", "b"), "inliers": 99}], 1, False), 2, 0)


@pytest.mark.parametrize(
    ("said", "told"),
    [
        ("nothing finds this part: mark it with --region and say", "select it by a click and say"),
        ("name what should change with --region, and look at it with gsedit render SCENE "
         "--region ...", "select what should change by a click"),
        (str(read("remove").refusal), "select it by a click"),
        (str(read("as a Van Gogh painting").refusal), "say another"),
        ("6 of 12 photos posed: trying again with more features (--no-retries: not)", "features"),
        (before_map(), "use the camera's own files with EXIF"),
    ],
)  # fmt: skip
def test_refusals_speak_of_the_page(said, told):
    assert told in on_page(said)
    assert "--" not in on_page(said)
