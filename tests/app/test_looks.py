"""Pictures of looks: each of the user's own scene, and a click on one says its sentence."""

import re

from gsedit.app.opening import open_path
from gsedit.app.panels.looks import LOOKS, PIXELS, Looks
from gsedit.app.reading import read


class Shown:
    content = ""


class Screen:
    def __init__(self):
        self.gui, self.shown = self, Shown()

    def add_html(self, _):
        return self.shown


def test_all_looks_are_sentences():
    assert not any(read(each).refusal for each in LOOKS.values())


def test_the_looks_are_made_of_the_scene_and_say_their_sentences(page, scene):
    open_path(page, scene)
    screen = Screen()
    looks = Looks(page, screen)
    assert "0 of" in screen.shown.content
    looks.make(lambda: True)
    assert len(re.findall('<img alt=""', screen.shown.content)) == len(LOOKS)
    assert 'data-do="say turn it into bronze"' in screen.shown.content
    assert len(set(page.pictures.values())) == len(LOOKS)  # no two are alike
    assert PIXELS < 200


def test_looks_that_are_not_wanted_any_more_are_not_made(page, scene):
    open_path(page, scene)
    Looks(page, Screen()).make(lambda: False)
    assert not page.pictures
