"""Make the pictures whose style docs/howto/recolor.md takes: `python make_paintings.py FOLDER`."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFilter

SIDE = 384
NIGHT = [
    (12, 20, 60),
    (25, 60, 130),
    (60, 120, 180),
    (150, 190, 200),
    (240, 210, 90),
    (250, 240, 180),
]
AUTUMN = [(90, 30, 20), (190, 60, 25), (225, 130, 40), (240, 200, 90), (120, 110, 40), (60, 50, 60)]


def smooth(draw: np.random.Generator, cells: int) -> np.ndarray:
    """A smooth random field in [0, 1]."""
    coarse = Image.fromarray((draw.random((cells, cells)) * 255).astype(np.uint8))
    return np.asarray(coarse.resize((SIDE, SIDE), Image.Resampling.BICUBIC)) / 255


def strokes(
    palette: list[tuple[int, int, int]], shares: Sequence[float], seed: int, *, dabs: bool
) -> Image.Image:
    """Strokes of a brush: long ones around five centers, or `dabs` all one way."""
    draw = np.random.default_rng(seed)
    picture = Image.new("RGB", (SIDE, SIDE), (120, 60, 30) if dabs else (20, 30, 70))
    canvas, (y, x) = ImageDraw.Draw(picture), np.mgrid[:SIDE, :SIDE] / SIDE
    field = 0.4 * np.sin(6 * y + 2 * x)
    for (cx, cy), sign in zip(draw.random((5, 2)), draw.choice([-1, 1], 5)):
        field = field + sign * np.exp(-((x - cx) ** 2 + (y - cy) ** 2) / 0.05)
    (down, right), low = np.gradient(field), smooth(draw, 6)
    ends, (length, width, count) = np.cumsum(shares), (7, 6, 14000) if dabs else (26, 5, 9000)
    for _ in range(count):
        column, row = draw.integers(0, SIDE, 2)
        angle = 0.6 if dabs else np.arctan2(right[row, column], -down[row, column])
        share = np.clip(low[row, column] + draw.normal(0, 0.12), 0, 0.999)
        place = min(len(palette) - 1, int(np.searchsorted(ends / ends[-1], share)))
        color = np.clip(np.array(palette[place]) + draw.normal(0, 14, 3), 0, 255).astype(int)
        half = length * (0.5 + draw.random()) / 2
        thick = max(1, int(width * (0.5 + draw.random())))
        dx, dy = np.cos(angle) * half, np.sin(angle) * half
        ends_of = [column - dx, row - dy, column + dx, row + dy]
        canvas.line(ends_of, fill=tuple(color.tolist()), width=thick)
    return picture.filter(ImageFilter.GaussianBlur(0.5))


def woodcut(seed: int) -> Image.Image:
    """Black lines and some blue on cream."""
    draw = np.random.default_rng(seed)
    y, x = np.mgrid[:SIDE, :SIDE]
    low = smooth(draw, 7)
    wave = np.sin((x * np.cos(3 * low) + y * np.sin(3 * low)) * 2 * np.pi / 9)
    ink, blue = (wave > 2.2 * low - 1.1)[..., None], (smooth(draw, 4) > 0.62)[..., None]
    colors = np.where(ink, np.where(blue, (40, 90, 110), (238, 228, 200)), (28, 24, 26))
    return Image.fromarray(colors.astype(np.uint8)).filter(ImageFilter.GaussianBlur(0.6))


def paintings(folder: Path) -> None:
    """Write night.png, autumn.png and woodcut.png."""
    folder.mkdir(parents=True, exist_ok=True)
    strokes(NIGHT, [3, 4, 3, 2, 1.2, 0.6], 0, dabs=False).save(folder / "night.png")
    strokes(AUTUMN, [2, 3, 3, 2, 1.5, 1], 1, dabs=True).save(folder / "autumn.png")
    woodcut(2).save(folder / "woodcut.png")


if __name__ == "__main__":
    paintings(Path(sys.argv[1]))
