"""Meanings of marked words: amounts, places, strengths and names, apart from the network."""

from __future__ import annotations

import re

import pytest

from gsedit.words.instruction import Change, Place
from gsedit.words.marks import values
from gsedit.words.marks.marked import Asked, Marked
from gsedit.words.marks.meaning import changes_of
from gsedit.words.phrases import owned
from gsedit.words.read import read_instruction
from gsedit.words.refusals import REASONS, Refused


def asked(deed: str, **given) -> Asked:
    """A change that is marked with certainty."""
    usual = {
        "tone": "", "part": "it", "of": "", "name": "", "amount": "", "after": "", "to": "",
        "sign": 0, "degree": "", "side": "", "way": "", "value": "", "value_sure": 0.0,
        "near": (), "sure": 1.0,
    }  # fmt: skip
    return Asked(deed, **{**usual, **given})


def meant(*changes: Asked, text: str = "", kept: tuple[str, ...] = ()) -> list[Change]:
    return changes_of(Marked(text, changes, kept, 0.0, 0.0, 0.0))


@pytest.mark.parametrize(
    ("amount", "after", "sign", "share"),
    [
        ("20 %", "darker", -1, -0.2), ("to 80 %", "", -1, -0.2), ("twice", "as", 1, 1.0),
        ("half", "as", -1, -0.5), ("a third", "darker", -1, -1 / 3), ("two stops", "", 1, 3.0),
        ("half a stop", "", -1, 2**-0.5 - 1), ("a third of a stop", "", -1, 2 ** (-1 / 3) - 1),
        ("a stop", "", -1, -0.5), ("+20", "", 1, 0.2), ("-10", "", -1, -0.1), ("", "", 1, 0.2),
        ("1.5x", "", 1, 0.5), ("2", "x", 1, 1.0), ("2", "x", -1, -0.5), ("double", "", 1, 1.0),
    ],
)  # fmt: skip
def test_an_amount_of_a_tone_is_a_signed_share(amount, after, sign, share):
    (change,) = meant(asked("tone", tone="brightness", amount=amount, after=after, sign=sign))
    assert (change.kind, change.name) == ("tone", "brightness")
    assert change.amount == pytest.approx(share, abs=1e-3)


@pytest.mark.parametrize(
    ("deed", "amount", "after", "sign", "degree", "text", "share"),
    [
        ("scale", "twice", "as", 1, "", "", 1.0), ("scale", "by 1.5", "", 1, "", "", 0.5),
        ("scale", "half", "the", -1, "", "", -0.5), ("scale", "to 150 %", "", 1, "", "", 0.5),
        ("scale", "20 %", "smaller", -1, "", "", -0.2), ("scale", "", "", 1, "", "", 0.3),
        ("scale", "", "", -1, "little", "", 1.3**-0.5 - 1),
        ("scale", "two times", "smaller", -1, "", "", -0.5),
        ("turn", "90 degrees", "", -1, "", "", -0.25),
        ("turn", "a quarter", "", -1, "", "", -0.25),
        ("turn", "", "", 0, "", "turn it around", 0.5),
        ("turn", "30", "", 1, "", "", 1 / 12), ("turn", "a third", "of", 1, "", "", 1 / 3),
    ],
)  # fmt: skip
def test_an_amount_of_an_object_is_a_share_of_its_size_or_of_a_circle(
    deed, amount, after, sign, degree, text, share
):
    one = asked(deed, amount=amount, after=after, sign=sign, degree=degree)
    (change,) = meant(one, text=text)
    assert (change.name, change.phrase) == (deed, "it")
    assert change.amount == pytest.approx(share, abs=1e-4)


@pytest.mark.parametrize(
    ("deed", "way", "to", "amount", "far", "place"),
    [
        ("move", "left of", "to the left of the table", "", None, Place("left", "the table")),
        ("move", "in front of", "in front of the red one", "", None, Place("front", "the red one")),
        ("move", "up", "up", "", None, Place("up")),
        ("move", "front", "closer", "", None, Place("forward")),
        ("move", "left", "to the left", "0.3 units", 0.3, Place("left", units=True)),
        ("move", "left", "to the left", "30 cm", 0.3, Place("left", metres=True)),
        ("copy", "beside", "", "", None, Place("beside", "it")),
        ("copy", "left", "on its left", "three", 3.0, Place("left", "it")),
    ],
)
def test_a_place_is_a_way_to_go_or_a_side_of_something(deed, way, to, amount, far, place):
    (change,) = meant(asked(deed, way=way, to=to, amount=amount))
    assert (change.name, change.amount, change.place) == (deed, far, place)


@pytest.mark.parametrize(
    ("name", "amount", "after", "share"),
    [
        ("fog", "50 %", "fog", -0.5), ("moonlight", "half", "strength", -0.5),
        ("fog", "double", "the", 1.0), ("lamp", "30 %", "dimmer", -0.3),
        ("lamp", "30 %", "brighter", 0.3), ("fog", "+50 %", "fog", 0.5), ("fog", "", "", None),
    ],
)  # fmt: skip
def test_a_light_is_as_strong_as_it_is_said(name, amount, after, share):
    (change,) = meant(asked("light", part="scene", name=name, amount=amount, after=after))
    assert (change.kind, change.name, change.amount) == ("light", name, share)


@pytest.mark.parametrize(
    ("made", "kind"),
    [
        ([asked("weather", name="fog", side="left")], "side"),
        ([asked("weather", name="rain", amount="50 %", after="more")], "strength"),
        ([asked("tone", tone="brightness", amount="900 %", sign=1)], "amount"),
        ([asked("scale", amount="1000 times", sign=1)], "size"),
        ([asked("copy", amount="40")], "copies"),
        ([asked("move", to="somewhere")], "direction"),
        ([asked("material", name="qwrtz")], "unknown"),
        ([asked("look", name="qwrtz")], "style"),
        ([asked("insert", part="span", of="a hat")], "insert"),
        ([asked("shape", name="wings")], "geometry"),
        ([asked("paint", name="red"), asked("paint", name="blue")], "two"),
        ([asked("light", name="night"), asked("light", name="noon")], "two"),
        ([asked("remove", part="scene")], "everything"),
    ],
)
def test_what_no_route_does_as_it_is_said_is_refused(made, kind):
    with pytest.raises(Refused) as refused:
        meant(*made)
    assert refused.value.args[0] == kind


def test_what_stays_is_left_out_of_what_changes():
    gold = asked("material", name="gold")
    vase = asked("paint", part="span", of="the vase", name="red")
    assert meant(vase, kept=("the table",))[0].keep == ("the table",)
    (all_but,) = meant(asked("tone", tone="warmth", part="scene", sign=1), kept=("the bear",))
    assert (all_but.target, all_but.phrase) == ("background", "the bear")
    assert meant(gold, kept=("the background",))[0].target == "subject"
    (gray,) = meant(asked("tone", tone="grayscale"), kept=("the car's blue", "the shadows"))
    assert (gray.phrase, owned(gray).phrase, owned(gray).keep) == ("the car's blue", "the car", ())
    (rest,) = meant(asked("paint", part="but", of="the bear", name="red"), kept=("the bear",))
    assert (rest.target, rest.phrase, rest.keep) == ("background", "the bear", ())
    for kept in ("the vase", "the rest of it"):
        one = vase if kept == "the vase" else asked("paint", part="background", name="red")
        with pytest.raises(Refused):
            meant(one, kept=(kept,))


def test_it_is_what_was_named_or_made_last():
    vase = asked("move", part="span", of="the vase", way="left", to="to the left")
    assert [each.phrase for each in meant(vase, asked("paint", name="red"))] == ["the vase"] * 2
    for said in ("", "double", "30 cm"):  # one copy
        copied = asked("copy", part="span", of="the vase", way="beside", amount=said)
        made = meant(copied, asked("material", name="gold"))
        assert (made[0].amount, made[1].phrase) == (None, "the copy")
    gone, warm = asked("remove", of="the vase"), asked("tone", part="scene", tone="warmth", sign=1)
    assert meant(gone, warm)[1].phrase == ""


@pytest.mark.parametrize(
    ("name", "of", "color"),
    [
        ("polished black granite", "polished black granite", "#000000"),
        ("rusty old iron", "iron", None),
        ("copper with green patina", "copper with green patina", None), ("fur", "wool", None),
        ("glow green", "glow", "#15b01a"), ("an oscar statuette", "gold", None),
    ],
)  # fmt: skip
def test_a_material_has_its_color_finish_and_trimming(name, of, color):
    change = values.material(name)
    assert change is not None
    assert of in change.name
    assert color in (None, change.color)


@pytest.mark.parametrize(
    ("find", "name", "made"),
    [
        (values.paint, "#3aa17e", ("#3aa17e", "#3aa17e")),
        (values.paint, "rgb(255, 0, 128)", ("#ff0080", "#ff0080")),
        (values.paint, "matte black", ("matte black", "#000000")),
        (values.look, "an old daguerreotype", ("sepia", None)),
        (values.look, "van gogh's starry night", ("starry night painting", None)),
        (values.cover, "wet", ("wet", None)), (values.cover, "ivy", ("moss", None)),
        (values.light, "early morning", ("sunrise", None)), (values.paint, "qwrtz", None),
    ],
)  # fmt: skip
def test_a_name_is_found_by_its_words(find, name, made):
    change = find(name)
    assert (change and (change.name, change.color)) == made


def test_what_is_said_twice_is_done_once():
    red = asked("paint", name="red", part="span", of="the vase")
    assert [str(each) for each in meant(red, red)] == ["the vase painted red (#e50000)"]
    dark = [asked("tone", tone="brightness", sign=-1, amount=each) for each in ("30 %", "")]
    assert [each.amount for each in meant(*dark)] == [-0.3]
    assert len(meant(asked("scale", sign=1), asked("scale", sign=1))) == 2


def test_things_in_the_background_are_not_the_background():
    (change,) = meant(asked("remove", part="background", of="the people in the background"))
    assert (change.target, change.phrase) == ("subject", "the people in the background")


def test_a_shadow_is_no_object():
    with pytest.raises(Refused, match="unreal"):
        meant(asked("remove", part="span", of="the shadow of the bear"))
    with pytest.raises(Refused, match="unreal"):
        meant(asked("light", name="the shadows", value="night", value_sure=0.9))


def test_long_shadows_are_those_of_a_low_sun():
    told = ("give it long evening shadows", "make the shadows longer", "shorter shadows",
            "moonlight with long shadows", "dawn with long shadows from the right")  # fmt: skip
    read = [change.name for each in told for change in read_instruction(each).changes]
    assert read == ["sunset", "sunset", "noon", "moonlight", "sunrise from the right"]


def test_less_of_a_shadow_is_lighter_and_more_of_it_deeper():
    told = ("put less shadow under the car", "fewer shadows", "reduce the shadows",
            "make the shadows of it weaker", "more shadow please", "stronger shadows")  # fmt: skip
    read = [change.amount for each in told for change in read_instruction(each).changes]
    assert [amount > 0 for amount in read] == [True] * 4 + [False] * 2


@pytest.mark.parametrize("why", REASONS.values())
def test_what_a_refusal_offers_is_read(why):
    for offered in re.findall(r"(?:as in |\()'([^']+ [^']+)'", why):
        assert read_instruction(offered).known, offered
