"""Two scenes side by side from the same cameras, and where they differ, as one picture."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.run.atomic import atomic_path
from gsedit.run.environment import load_extra

LEAST_DIFFERENCE = 4 / 255
"""Least end of the scale of differences: a few steps of an 8-bit picture are not shown as much."""
CELL_INCHES = 3.0
"""Width of a picture, inches; 100 pixels each."""
_PLAIN: dict[str, Any] = {"fontsize": 9, "loc": "left", "parse_math": False}
"""Style of titles: a dollar sign in the name of a file begins no formula."""


class Pair(NamedTuple):
    """One view of both scenes, in [0, 1]."""

    title: str
    before: Float[Tensor, "h w 3"]
    after: Float[Tensor, "h w 3"]


def difference_picture(
    pairs: Sequence[Pair], names: tuple[str, str], path: Path | str, *, overwrite: bool = False
) -> None:
    """Write a PNG: a row a view, with before, after, and the absolute difference in a color scale.

    The difference of a pixel is that of its most different channel; the scale ends at the 99.9th
    percentile over all rows, at least 4/255, and a bar tells its values. `names` are those of the
    scenes. Raises ValueError without views, GseditError without matplotlib, and as `atomic_path`
    does.
    """
    # not pyplot: no global state, no window system
    drawing = load_extra("matplotlib.figure", "a picture of differences")
    if not pairs:
        raise ValueError("a picture of differences needs at least one view")
    differences = [(pair.after - pair.before).abs().amax(-1) for pair in pairs]
    ordered = torch.cat([each.flatten() for each in differences]).sort().values
    most = max(float(ordered[int(0.999 * (len(ordered) - 1))]), LEAST_DIFFERENCE)
    height, width = pairs[0].before.shape[:2]
    rows = len(pairs)
    size = (3 * CELL_INCHES + 1.2, rows * (CELL_INCHES * height / width + 0.3) + 0.4)
    figure = drawing.Figure(figsize=size, layout="constrained")
    axes = figure.subplots(rows, 3, squeeze=False)
    for (title, before, after), difference, row in zip(pairs, differences, axes):
        row[0].imshow(before.cpu().numpy(), interpolation="nearest")
        row[1].imshow(after.cpu().numpy(), interpolation="nearest")
        row[2].imshow(
            difference.cpu().numpy(), vmin=0, vmax=most, cmap="magma", interpolation="nearest"
        )
        row[0].set_title(title, **_PLAIN)
        for each in row:
            each.set_axis_off()
    heads = (
        f"{names[0]}\n{pairs[0].title}",
        f"{names[1]}\n",
        f"difference, {1 / most:.3g} times\n",
    )
    for column, head in zip(axes[0], heads):
        column.set_title(head, **_PLAIN)
    bar = figure.colorbar(axes[0, 2].images[0], ax=axes, fraction=0.03, pad=0.01, extend="max")
    bar.set_label("largest difference of a channel, colors in [0, 1]", fontsize=8)
    with atomic_path(path, overwrite=overwrite) as temporary:
        figure.savefig(temporary, format="png", dpi=100)
