"""Painting styles on the page: one is said when it is chosen, all are shown on the view."""

from types import SimpleNamespace
from unittest.mock import MagicMock

import numpy as np
import torch
from plain_scenes import cloud, ring

from gsedit.app.panels.say import NONE, THUMBNAIL, Styles
from gsedit.words.lexicon import styles


def panel(scene=None, selection=None):
    """The styles of a tab that does work at once."""
    tab = MagicMock()
    tab.safely = lambda function: function
    tab.soon = lambda key, work, then: then(work())
    tab.camera = lambda: ring(1)[0]
    page = SimpleNamespace(selection=selection, has_scene=scene is not None, scene=scene)
    say = MagicMock(tab=tab, page=page)
    say.waited = lambda work: work
    return Styles(say)


def test_a_style_that_is_chosen_is_said_and_previewed():
    names = iter(styles())
    for selection, said in ((None, "in the style of "), (object(), "it in the style of ")):
        made, name = panel(selection=selection), next(names)
        made.names.value = name
        made.chosen(SimpleNamespace(client=object()))
        assert made.say.text.value == said + name
        made.say.preview.assert_called_once()


def test_nothing_is_said_without_a_choice_of_a_person():
    made = panel()
    for client, value in ((None, next(iter(styles()))), (object(), NONE)):
        made.names.value = value
        made.chosen(SimpleNamespace(client=client))
    made.say.preview.assert_not_called()


def test_the_view_is_shown_in_every_style():
    made = panel(cloud(torch.rand(200, 3), -3.0))
    made.paint()
    (sheet,), _ = made.say.tab.gui.add_image.call_args
    assert sheet.dtype == np.uint8
    assert min(sheet.shape[:2]) > 3 * THUMBNAIL / 2
    first = made.sheet
    made.paint()
    first.remove.assert_called_once()
    panel().paint()  # without a scene nothing is
