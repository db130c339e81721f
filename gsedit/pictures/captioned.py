"""Pictures in rows, each over its name."""

from __future__ import annotations

from collections.abc import Sequence

from PIL import Image, ImageDraw, ImageFont

MARGIN, CAPTION = 6, 20
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
