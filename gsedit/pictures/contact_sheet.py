"""Pictures of the same views side by side, in labelled rows: original, target, final."""

from __future__ import annotations

from collections.abc import Sequence

from PIL import Image, ImageDraw, ImageFont, ImageOps

from gsedit.formats.pictures import as_picture
from gsedit.views.dataset import View, evenly_spaced

COLUMNS = 8  # more views than this on one sheet are too small to judge
CELL_PIXELS = (128, 320)  # smaller pictures are enlarged to the first, larger reduced to the second
MARGIN = 4  # pixels between cells
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
    shown = [
        *evenly_spaced(count - apart, columns - apart),
        *range(count - apart, count),
    ]
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
