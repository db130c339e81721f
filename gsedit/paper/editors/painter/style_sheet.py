"""All styles of the painter on one view of a scene, as a sheet of named pictures."""

from __future__ import annotations

from collections.abc import Sequence

from PIL import Image

from gsedit.formats.pictures import as_picture
from gsedit.paper.editors.painter.editor import load_painter
from gsedit.paper.editors.painter.network import painted
from gsedit.pictures.contact_sheet import captioned
from gsedit.scene.picture import render_picture
from gsedit.views.around import score_render
from gsedit.views.dataset import evenly_spaced
from gsedit.views.viewpoints import Viewpoint
from gsedit.words.lexicon import styles
from rasterizer.scene import Gaussians

CELL = 256
"""Longer side of a picture, pixels: it is painted at this size."""
COLUMNS = 7
"""Pictures beside each other."""
JUDGED, JUDGED_SIZE = 8, 64
"""Views of which the one is taken that shows most, and the longer side of the renders that tell."""


def style_sheet(scene: Gaussians, viewpoints: Sequence[Viewpoint]) -> Image.Image:
    """One view of a scene, as it is and in every style.

    Raises InputError where the painter's weights are missing or damaged.
    """
    judged = [viewpoints[i].camera for i in evenly_spaced(len(viewpoints), JUDGED)]
    best = max(judged, key=lambda each: score_render(scene, each.fitted(JUDGED_SIZE)).score)
    shown = render_picture(scene, best)
    painter = load_painter()
    cells = [("unedited", shown)]
    for name, number in styles().items():
        cells.append((name, painted(painter.network, shown[None], painter.styles[number])[0]))
    return captioned([(name, as_picture(picture)) for name, picture in cells], COLUMNS)
