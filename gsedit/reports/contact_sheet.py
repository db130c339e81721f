"""Pictures of the same views side by side, in labelled rows: original, target, final."""

from __future__ import annotations

from collections.abc import Sequence

from PIL import Image, ImageDraw, ImageFont

from gsedit.files.pictures import as_picture
from gsedit.views.dataset import View, evenly_spaced

COLUMNS = 8  # more views than this on one sheet are too small to judge
CELL = (
    128,
    320,
)  # pixels: smaller pictures are enlarged to the first, larger reduced to the second
MARGIN = 4  # pixels between cells
LABEL = 22  # pixels above a row


def contact_sheet(
    rows: Sequence[tuple[str, Sequence[View]]], *, columns: int = COLUMNS
) -> Image.Image:
    """Rows of labelled pictures, one column a camera: original, edited target, final render.

    Every row holds the same cameras in the same order; beyond `columns` of them, evenly spaced ones
    are shown. Raises ValueError where the rows are empty or differ in length.
    """
    counts = {len(views) for _, views in rows}
    if len(counts) != 1 or 0 in counts:
        raise ValueError(f"a sheet needs rows of equal, non-zero length; got {sorted(counts)}")
    shown = evenly_spaced(counts.pop(), columns)
    cell_w, cell_h = _cell_size([views[i] for _, views in rows for i in shown])
    row_h = LABEL + cell_h + MARGIN
    sheet = Image.new(
        "RGB", (MARGIN + len(shown) * (cell_w + MARGIN), MARGIN + len(rows) * row_h), "white"
    )
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(14)
    for row, (label, views) in enumerate(rows):
        top = MARGIN + row * row_h
        draw.text((MARGIN, top + 2), label, fill="black", font=font)
        for column, index in enumerate(shown):
            picture = _fitted(as_picture(views[index].image), cell_w, cell_h)
            left = MARGIN + column * (cell_w + MARGIN) + (cell_w - picture.width) // 2
            sheet.paste(picture, (left, top + LABEL + (cell_h - picture.height) // 2))
    return sheet


def _cell_size(views: Sequence[View]) -> tuple[int, int]:
    """Width and height that the largest picture gets, its longer side within CELL."""
    width, height = (max(view.image.shape[axis] for view in views) for axis in (1, 0))
    longest = max(width, height)
    scale = min(max(longest, CELL[0]), CELL[1]) / longest
    return round(width * scale), round(height * scale)


def _fitted(picture: Image.Image, width: int, height: int) -> Image.Image:
    scale = min(width / picture.width, height / picture.height)
    size = (max(1, round(picture.width * scale)), max(1, round(picture.height * scale)))
    return picture.resize(size, Image.Resampling.LANCZOS)
