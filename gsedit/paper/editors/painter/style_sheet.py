"""All styles of the painter on one view of a scene, as a sheet of named pictures."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from jaxtyping import Float
from PIL import Image
from torch import Tensor

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
    """One view of a scene, as it is and in every style."""
    judged = [viewpoints[i].camera for i in evenly_spaced(len(viewpoints), JUDGED)]
    best = max(judged, key=lambda each: score_render(scene, each.fitted(JUDGED_SIZE)).score)
    shown = render_picture(scene, best)
    cells = [("unedited", shown), *in_every_style(shown)]
    return captioned([(name, as_picture(picture)) for name, picture in cells], COLUMNS)


def in_every_style(picture: Float[Tensor, "h w 3"]) -> Iterator[tuple[str, Float[Tensor, "h w 3"]]]:
    """Each style's name, and the picture painted in it.

    Raises InputError where the painter's weights are missing or damaged.
    """
    painter = load_painter()
    for name, number in styles().items():
        yield name, painted(painter.network, picture[None], painter.styles[number])[0]
