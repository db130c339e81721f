"""Pictures in rows, each over its name, or of the same views in labelled rows, and where scenes
differ from what they are compared with."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import torch
from jaxtyping import Float
from PIL import Image, ImageDraw, ImageFont, ImageOps
from torch import Tensor

from gsedit.formats.pictures import as_picture, save_picture
from gsedit.measures.agreement import spread
from gsedit.measures.metrics import EvaluationInput
from gsedit.views.dataset import View, evenly_spaced
from rasterizer.render import render_picture

MARGIN, CAPTION = 4, 20
"""Pixels between pictures, and below each."""
PAPER, INK = (250, 250, 248), (40, 40, 40)


def captioned(cells: Sequence[tuple[str, Image.Image]], columns: int) -> Image.Image:
    """A sheet of named pictures, at most so many beside each other."""
    columns = min(columns, len(cells))
    rows = -(-len(cells) // columns)
    width, height = (max(getattr(cell, side) for _, cell in cells) for side in ("width", "height"))
    step_x, step_y = width + MARGIN, height + CAPTION
    sheet = Image.new("RGB", (MARGIN + columns * step_x, MARGIN + rows * step_y), PAPER)
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(13)
    for i, (name, cell) in enumerate(cells):
        left, top = MARGIN + i % columns * step_x, MARGIN + i // columns * step_y
        sheet.paste(cell, (left, top))
        draw.text((left + 2, top + cell.height + 2), name, fill=INK, font=font)
    return sheet


COLUMNS = 8  # more views than this on one sheet are too small to judge
CELL_PIXELS = (128, 320)  # smaller pictures are enlarged to the first, larger reduced to the second
GAP = 16  # pixels before the columns that stand apart
LABEL = 22  # pixels above a row


def contact_sheet(
    rows: Sequence[tuple[str, Sequence[View | None]]],
    *,
    columns: int = COLUMNS,
    apart: int = 0,
    caption: str = "",
) -> Image.Image:
    """Rows of labelled pictures, one column a camera: original, edited target, final render.

    Every row holds the same cameras in the same order, None where there is no picture. The last
    `apart` columns stand apart under the `caption`, and are all shown; of the others, evenly spaced
    ones where there are more than `columns` in all. Raises ValueError where the rows are empty or
    differ in length.
    """
    counts = {len(views) for _, views in rows}
    if len(counts) != 1 or 0 in counts:
        raise ValueError(f"a sheet needs rows of equal, non-zero length; got {sorted(counts)}")
    count = counts.pop()
    shown = [*evenly_spaced(count - apart, columns - apart), *range(count - apart, count)]
    pictures = [view for _, views in rows for i in shown if (view := views[i])]
    cell_w, cell_h = _cell_size(pictures)
    row_h = LABEL + cell_h + MARGIN
    width = MARGIN + len(shown) * (cell_w + MARGIN) + (GAP if apart else 0)
    sheet = Image.new("RGB", (width, MARGIN + len(rows) * row_h), "white")
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(14)
    for row, (label, views) in enumerate(rows):
        top = MARGIN + row * row_h
        draw.text((MARGIN, top + 2), label, fill="black", font=font)
        for column, index in enumerate(shown):
            beside = GAP if index >= count - apart else 0
            left = MARGIN + column * (cell_w + MARGIN) + beside
            if row == 0 and index == count - apart:
                draw.text((left, top + 2), caption, fill="black", font=font)
            if (view := views[index]) is None:
                continue
            picture = ImageOps.contain(
                as_picture(view.image), (cell_w, cell_h), Image.Resampling.LANCZOS
            )
            left += (cell_w - picture.width) // 2
            sheet.paste(picture, (left, top + LABEL + (cell_h - picture.height) // 2))
    return sheet


def _cell_size(views: Sequence[View]) -> tuple[int, int]:
    """Width and height that the largest picture gets, its longer side within CELL_PIXELS."""
    width = max(view.camera.width for view in views)
    height = max(view.camera.height for view in views)
    longest = max(width, height)
    scale = min(max(longest, CELL_PIXELS[0]), CELL_PIXELS[1]) / longest
    return round(width * scale), round(height * scale)


EDITED, HELD_OUT = 4, 2
"""Most views that are shown of each kind."""
AMPLIFIED = 4
"""How much larger differences are drawn than they are."""


def difference_sheet(
    subject: EvaluationInput, path: Path, targets: str, *, overwrite: bool = False
) -> None:
    """Write a PNG: the unedited scene, the pictures that it should show (`targets` says what they
    are), the scene, and the absolute difference to the first of the two rows that there is, four
    times. Raises UsageError as `atomic_path` does."""
    held_out = spread(subject.views.having("held_out"), HELD_OUT)
    shown = (*spread(subject.views.having("edited"), EDITED), *held_out)

    def views(pictures: dict[int, Float[Tensor, "h w 3"]]) -> list[View | None]:
        viewpoints = subject.views.viewpoints
        return [
            View(viewpoints[i].name, viewpoints[i].camera, pictures[i]) if i in pictures else None
            for i in shown
        ]

    cameras = {i: subject.views.viewpoints[i].camera for i in shown}
    finals = {i: render_picture(subject.scene, each) for i, each in cameras.items()}
    rows, before = [], {}
    if subject.unedited is not None:
        original = subject.unedited
        before = {i: render_picture(original, each) for i, each in cameras.items()}
        rows.append(("unedited scene", views(before)))
    wanted = {i: subject.targets[i] for i in shown if i in subject.targets}
    if wanted:
        rows.append((targets, views(wanted)))
    expected, named = (before, "unedited scene") if before else (wanted, targets)
    differences = {
        i: (AMPLIFIED * (finals[i] - picture).abs()).clamp(0, 1) for i, picture in expected.items()
    }
    rows += [
        ("this scene", views(finals)),
        (f"difference to the {named}, {AMPLIFIED} times", views(differences)),
    ]
    sheet = contact_sheet(rows, apart=len(held_out), caption="held out" if held_out else "")
    save_picture(sheet, path, overwrite=overwrite)


def difference_picture(
    before: Sequence[View],
    after: Sequence[View],
    names: tuple[str, str],
    path: Path,
    *,
    overwrite: bool = False,
) -> None:
    """Write a PNG of two scenes from the same cameras, under their names, and of their difference.

    The difference of a pixel is that of its most different channel; white is the 99.9th percentile
    over all views, at least 4/255. Raises UsageError as `atomic_path` does.
    """
    apart = [(b.image - a.image).abs().amax(-1, keepdim=True) for a, b in zip(before, after)]
    ordered = torch.cat([each.flatten() for each in apart]).sort().values
    most = max(float(ordered[int(0.999 * (len(ordered) - 1))]), 4 / 255)
    differences = [
        View(view.name, view.camera, (each / most).clamp(0, 1).expand(-1, -1, 3))
        for view, each in zip(before, apart)
    ]
    title = f"largest difference of a channel, {1 / most:.3g} times"
    rows = [(names[0], before), (names[1], after), (title, differences)]
    save_picture(contact_sheet(rows), path, overwrite=overwrite)
