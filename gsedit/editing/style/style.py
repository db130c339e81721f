"""The style of a picture for a scene: no text, no editor, no photos.

First the colors: sliced optimal transport in Lab from the colors of renders to the picture's.
Then the texture: base colors descend a Gram loss on the features of renders. `n` Gaussians.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.editing.style.studio import Studio, StyleLoss, StyleMeasure, StyleSettings, sized
from gsedit.errors import UsageError
from gsedit.formats.pictures import read_picture
from gsedit.measures.features import FeatureExtractor, FilterBank
from gsedit.run.events import Event
from gsedit.run.stopwatch import Stopwatch
from gsedit.scene.table import table_of
from gsedit.select.rules import EVERYTHING, Selection
from gsedit.toolkit.filter import as_selection
from gsedit.views.around import around
from gsedit.views.dataset import Dataset, evenly_spaced
from rasterizer.scene import Gaussians

MIN_PICTURE_PIXELS = 16
"""Fewest pixels a side of a picture that a style is taken from."""
MAX_MEASURED_VIEWS = 4
"""Most held-out views that are measured at."""


@dataclass(frozen=True, eq=False)
class StyleResult:
    """A scene in the style of a picture."""

    scene: Gaussians
    colored: Gaussians
    """The scene after the colors, before the texture."""
    measures: tuple[StyleMeasure, ...]


def style_steps(
    scene: Gaussians,
    picture: Float[Tensor, "h w 3"],
    *,
    dataset: Dataset | None = None,
    settings: StyleSettings | None = None,
    features: FeatureExtractor | None = None,
    where: Selection | str = EVERYTHING,
    generator: torch.Generator | None = None,
) -> Iterator[Event | StyleResult]:
    """Give a scene the style of a picture, sRGB in [0, 1]; yields events, and last the result.

    The cameras are those of `dataset` (without one, found); its photos are not looked at. Only the
    selected Gaussians change, and of those only the colors; a text for `where` is an expression.
    `features` of the Gram loss: a bank of oriented filters if None. Raises UsageError for an empty
    scene, a picture of fewer than 16 pixels a side, or where nothing is selected or no view shows
    it.
    """
    settings, watch, scene = settings or StyleSettings(), Stopwatch(), scene.detach()
    generator = generator or torch.Generator().manual_seed(0)
    studio = _studio(scene, picture, dataset, settings, as_selection(where))
    measures = [studio.measure("before", scene, scene, watch.seconds)]
    yield Event("before", watch.seconds, 1, 1, note=str(measures[-1]))
    colored = studio.with_colors(scene) if settings.strength else scene
    measures.append(studio.measure("colors", colored, scene, watch.seconds))
    yield Event("colors", watch.seconds, 1, 1, note=str(measures[-1]))
    styled = colored
    if settings.steps and settings.strength:
        weight = settings.content / settings.strength
        loss = StyleLoss(studio.picture, features or FilterBank(), weight)
        for item in studio.with_texture(colored, loss, generator):
            if isinstance(item, Gaussians):
                styled = item
                continue
            step, value = item
            yield Event("texture", watch.seconds, step, settings.steps, loss=value)
        measures.append(studio.measure("texture", styled, scene, watch.seconds))
        yield Event("measure", watch.seconds, 1, 1, note=str(measures[-1]))
    yield StyleResult(styled, colored, tuple(measures))


def _studio(
    scene: Gaussians,
    picture: Float[Tensor, "h w 3"],
    dataset: Dataset | None,
    settings: StyleSettings,
    selection: Selection,
) -> Studio:
    """The views, and what may change. Raises UsageError."""
    if min(picture.shape[:2]) < MIN_PICTURE_PIXELS:
        raise UsageError("the picture has fewer than 16 pixels a side: it has no style to take")
    if not len(scene):
        raise UsageError("the scene is empty: there is nothing to see")
    dataset = dataset or around(scene, execution=settings.execution)
    views, held_out = dataset.split()
    views = views or held_out
    inside = torch.from_numpy(selection.mask(table_of(scene)).copy())
    if not inside.any():
        raise UsageError("nothing is selected: there is nothing to paint")
    return Studio(
        picture=sized(picture, views[0].camera),
        cameras=[views[i].camera for i in evenly_spaced(len(views), settings.views)],
        held_out=[held_out[i].camera for i in evenly_spaced(len(held_out), MAX_MEASURED_VIEWS)],
        inside=None if inside.all() else inside,
        settings=settings,
    )


def style(
    scene: Gaussians,
    picture: Float[Tensor, "h w 3"] | Path | str,
    *,
    dataset: Dataset | None = None,
    settings: StyleSettings | None = None,
    features: FeatureExtractor | None = None,
    where: Selection | str = EVERYTHING,
    generator: torch.Generator | None = None,
) -> StyleResult:
    """`style_steps` to the end; a path is read as a picture."""
    image = picture if isinstance(picture, Tensor) else read_picture(Path(picture))
    steps = style_steps(
        scene,
        image,
        dataset=dataset,
        settings=settings,
        features=features,
        where=where,
        generator=generator,
    )
    last = deque(steps, maxlen=1).pop()
    assert isinstance(last, StyleResult)
    return last
