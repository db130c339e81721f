"""Decisions are readable: one screen of 80 columns, one line for a log."""

from __future__ import annotations

from gsedit.paper.skips import Decision, one_line, screen

TAKEN = Decision(
    "merging",
    True,
    "The region shows in 12% of all crops: only these are drawn",
    "1,500 of 4,000 crops",
    0.375,
    "the crops of the update",
    0.0039,
    "of a color",
)
NEEDED = Decision("views", False, "Needed: 12 views cover 93%, 95% are wanted")


def test_the_screen_has_80_columns_and_what_applies_comes_first():
    text = screen([NEEDED, TAKEN])
    lines = text.splitlines()
    assert max(map(len, lines)) <= 80
    assert lines[0].startswith("- merging ")
    joined = " ".join(text.split())
    assert "1,500 of 4,000 crops. The region shows in 12%" in joined
    assert "Saves 38% of the crops of the update. Error at most 0.0039 of a color." in joined
    assert "views Needed: 12 views cover 93%" in joined


def test_a_line_lists_what_is_skipped():
    assert one_line([NEEDED, TAKEN]) == "skipped: merging (1,500 of 4,000 crops)"
    assert one_line([NEEDED]) == "skipped: nothing"
