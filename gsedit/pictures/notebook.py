"""Notebook displays of scenes and results: small pictures, and tables as HTML.

`_repr_png_` and `_repr_html_` call these through `attempt`: a notebook shows the text of an object
where they fail, and never an error.
"""

from __future__ import annotations

import base64
import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from html import escape
from io import BytesIO
from typing import TypeVar

import torch
from PIL import Image, ImageDraw, ImageFont

from gsedit.formats.pictures import as_picture
from gsedit.scene.framing import framing_camera
from rasterizer.render import render
from rasterizer.scene import Gaussians

SIZE_PIXELS = (400, 300)
"""Width and height, pixels."""
Shown = TypeVar("Shown")


def attempt(show: Callable[[], Shown]) -> Shown | None:
    """Return the result of `show`, or None where it raises."""
    try:
        return show()
    except Exception:
        return None


@torch.no_grad()
def scene_png(scene: Gaussians) -> bytes:
    """A picture of the bulk of the scene, with its count and SH degree below."""
    drawn = thinned_out(scene.detach())
    image = render(
        drawn, framing_camera(drawn, size=SIZE_PIXELS), background=torch.ones(3).to(drawn.means)
    ).color
    picture = Image.new("RGB", (SIZE_PIXELS[0], SIZE_PIXELS[1] + 20), "white")
    picture.paste(as_picture(image.float()), (0, 0))
    text = f"{len(scene):,} Gaussians, SH degree {scene.degree}"
    font = ImageFont.load_default(12)
    ImageDraw.Draw(picture).text((4, SIZE_PIXELS[1] + 3), text, fill="black", font=font)
    return png_bytes(picture)


def thinned_out(scene: Gaussians) -> Gaussians:
    """Every k-th Gaussian, at most 200,000, with k times the area, so that surfaces stay closed."""
    step = -(-len(scene) // 200_000)
    if step <= 1:
        return scene
    some = scene[::step]
    return replace(some, log_scales=some.log_scales + 0.5 * math.log(step))


def png_bytes(picture: Image.Image) -> bytes:
    buffer = BytesIO()
    picture.save(buffer, format="PNG")
    return buffer.getvalue()


def as_html(title: str, rows: Mapping[str, str], png: bytes) -> str:
    """A heading, a table of the rows that have a value, and the picture inside the text."""
    cells = "".join(
        f"<tr><td style='text-align:left'>{escape(name)}</td>"
        f"<td style='text-align:left'>{escape(value)}</td></tr>"
        for name, value in rows.items()
        if value
    )
    data = base64.b64encode(png).decode()
    return (
        f"<div><b>{escape(title)}</b><table>{cells}</table>"
        f"<img alt='{escape(title, quote=True)}' src='data:image/png;base64,{data}'></div>"
    )


def decibels(value: float | None) -> str:
    """With its unit; empty where there is no value."""
    return "" if value is None else f"{value:.1f} dB"
