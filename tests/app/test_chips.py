"""Chips: each is of the sentence, and a chip that is changed changes that alone."""

import re
from dataclasses import replace

import pytest

from gsedit.app.chips import chips_of, offers, said
from gsedit.app.reading import knobs_of, read
from gsedit.words.read import read_instruction


def heard(text):
    return read_instruction(text, ())


def chips(text, **how):
    reading = read(text)
    knobs = knobs_of(reading.instruction, heard)
    return chips_of(reading, knobs, heard, **how), reading, knobs


def test_chips_are_the_part_the_change_its_color_and_its_amount():
    told, _, _ = chips("paint it glossy red, and make the background 30 % darker")
    for part in ('data-do="target 0"', "#e50000", 'type="color"', ">glossy<", 'type="range"'):
        assert part in told
    assert 'value="-0.3"' in told
    assert "the selection" in chips("paint it red", selected=True)[0]


@pytest.mark.parametrize(
    "text",
    ["turn it into bronze", "paint it red", "make it 20 % darker", "make it night", "remove it",
     "a thick layer of snow on it", "in the style of Van Gogh"],
)  # fmt: skip
def test_every_choice_of_a_chip_is_read_as_what_it_says(text):
    told, reading, knobs = chips(text)
    for action, options in re.findall(r'<select[^>]*data-do="([^"]+)"[^>]*>(.*?)</select>', told):
        for value in re.findall(r'value="([^"]*)"', options)[:12]:
            again = heard(said(reading, knobs, action, value))
            assert again.known, value
            (change,) = again.changes
            if action.startswith("target"):
                assert change.target == value
            if action.startswith("name"):
                assert change.name == value


def test_every_control_has_a_name_and_nothing_of_the_sentence_is_html():
    told, _, _ = chips("turn it into bronze and make the background 10 % darker")
    for control in re.findall(r"<(?:select|input)[^>]*>", told):
        assert "aria-label" in control or '<label class="amount">' in told
    assert "<b>" not in chips("paint the <b>red</b> one blue")[0]


@pytest.mark.parametrize(
    ("text", "offered"),
    [
        ("paint it zorp", r"say paint it \w+"),
        ("do not paint it red", "say paint it blue"),
        ("like a vaporwave hologram", r"say like a [\w ]+ hologram"), ("undo", "-"),
    ],
)  # fmt: skip
def test_what_a_refusal_offers_is_a_button_where_it_is_read(text, offered):
    found = re.findall('data-do="([^"]+)"', offers(read(text), ()))
    assert all(re.fullmatch(offered, each) for each in found)
    assert not any(read(each.removeprefix("say ")).refusal for each in found)
    assert bool(found) == (text != "undo")


def test_what_was_not_read_is_told_and_can_be_accepted():
    reading = read("paint it red")
    left = replace(reading.instruction, refusal="unread", unread=("tires <b>",))
    unread = replace(reading, instruction=left)
    assert 'data-do="accept"' in offers(unread, ())
    assert 'role="note" aria-label="not read: tires &lt;b&gt;"' in chips_of(unread, (), heard)
    assert "not read" not in chips_of(reading, (), heard)
