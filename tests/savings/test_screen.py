"""Decisions are readable: one screen of 80 columns, one line for a log."""

from __future__ import annotations

from gsedit.savings.decision import Bound, Decision, LeftOut, one_line, screen

TAKEN = Decision(
    "crops",
    True,
    "The region shows in 12% of all crops: only these are drawn",
    (LeftOut(1500, 4000, "crops"),),
    0.375,
    "the crops of the update",
    Bound(0.0039, "of a colour"),
)
NEEDED = Decision("correspondences", False, "Needed: all 66 pairs of views overlap, by 8% at least")


def test_the_screen_has_80_columns_and_what_applies_comes_first():
    text = screen([NEEDED, TAKEN])
    lines = text.splitlines()
    assert max(map(len, lines)) <= 80
    assert lines[0].startswith("- crops ")
    joined = " ".join(text.split())
    assert "1,500 of 4,000 crops. The region shows in 12%" in joined
    assert "Saves 38% of the crops of the update. Error at most 0.0039 of a colour." in joined
    assert "correspondences Needed: all 66 pairs" in joined


def test_a_line_lists_what_is_left_out():
    assert one_line([NEEDED, TAKEN]) == "left out: crops (1,500 of 4,000 crops)"
    assert one_line([NEEDED]) == "left out: nothing"
    assert str(Bound(0.0, "")) == "0: nothing changes"
