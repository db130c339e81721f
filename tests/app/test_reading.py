"""A sentence as the page tells it while it is typed."""

import pytest

from gsedit.app.reading import SECONDS, USUAL_COUNT, read
from gsedit.capture.causes import Evidence, cause
from gsedit.errors import ON_PAGE, Said, UsageError, on_page


def test_a_reading_tells_how_long_it_takes():
    assert read("make it night").seconds(USUAL_COUNT) == SECONDS["light"]


@pytest.mark.parametrize("text", ["asdf qwer", "turn it into pixel art", "undo", "<b>"])
def test_what_is_refused_tells_why(text):
    reading = read(text)
    assert reading.refusal
    assert reading.first is None


def before_map():
    features = {"a": 900, "b": 900}
    return cause(Evidence(features, [{"names": ("a", "b"), "inliers": 99}], False), 2, 0)


@pytest.mark.parametrize(
    ("said", "told"),
    [
        (Said("nothing finds this part", "select-part"), "select it by a click and say"),
        (Said("no one", "select-kind", kind="wall"), "say 'the wall'"),
        ("photos/: " + before_map(), "photos/: the photos match but do not fit"),
        (before_map(), "use the camera's own files with EXIF"),
    ],
)
def test_next_moves_are_those_of_the_page(said, told):
    assert "--" in said
    shown = on_page(UsageError(said))
    assert told in shown
    assert "--" not in shown


def test_the_pages_moves_name_no_options():
    assert "--" not in "".join(ON_PAGE.values())
