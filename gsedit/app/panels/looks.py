"""Materials, lights and styles as pictures of the user's own scene, made behind all other work."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Callable
from contextlib import suppress
from html import escape
from io import BytesIO
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image

from gsedit.app.previews import Previewer
from gsedit.app.reading import read
from gsedit.app.tab import button
from gsedit.errors import GseditError
from gsedit.formats.pictures import eight_bits
from rasterizer.camera import Camera
from rasterizer.render import render_picture

if TYPE_CHECKING:
    from gsedit.app.page import Page
    from gsedit.app.tab import Tab

LOOKS = {
    "bronze": "turn it into bronze", "gold": "turn it into gold",
    "marble": "turn it into marble", "glass": "turn it into glass",
    "night": "make it night", "sunset": "make it sunset", "fog": "make it foggy",
    "snow": "make it snow", "autumn": "autumn", "Van Gogh": "in the style of Van Gogh",
    "stained glass": "in stained glass", "sketch": "in the style of a pencil sketch",
}  # fmt: skip
"""Names of the looks that are shown, and their sentences."""
PIXELS = 112
"""Longer side of a picture."""


def uri_of(picture: np.ndarray) -> str:
    """A picture (h w 3, uint8) as an address that holds it."""
    file = BytesIO()
    Image.fromarray(picture).save(file, "JPEG", quality=80)
    return f"data:image/jpeg;base64,{b64encode(file.getvalue()).decode()}"


class Looks:
    """The pictures below one tab's sentence: a click says the sentence of one."""

    def __init__(self, page: Page, tab: Tab) -> None:
        """Add the place of the pictures."""
        self.page = page
        self.shown = tab.gui.add_html("")
        self.show()

    def show(self) -> None:
        """Show the pictures that are made."""
        known, count = self.page.pictures, len(LOOKS)
        if not self.page.has_scene:
            self.shown.content = ""
            return
        cells = [
            button(
                f"say {sentence}", f'<img alt="" src="{known[name]}">{escape(name)}',
                kind="look", label=sentence,
            )
            for name, sentence in LOOKS.items() if name in known
        ]  # fmt: skip
        wait = f'<div class="told">Looks of this scene: {len(cells)} of {count}…</div>'
        shown = f'<div class="looks">{"".join(cells)}</div>'
        self.shown.content = shown + wait * (len(cells) < count)

    def make(self, wanted: Callable[[], bool]) -> None:
        """Make the pictures that are missing, of the scene as it is now, while it is `wanted`."""
        with self.page.drawing:
            self.draw(wanted)

    def draw(self, wanted: Callable[[], bool]) -> None:
        """Make them, as the only thread that does."""
        page, pictures = self.page, self.page.pictures
        missing = [name for name in LOOKS if name not in pictures]
        if missing and wanted():
            previewer = Previewer(page.loaded, None)
            camera = page.loaded.first_camera().fitted(PIXELS)
            for name in missing:
                with suppress(GseditError):
                    if wanted():
                        pictures[name] = uri_of(looked(previewer, LOOKS[name], camera))
                        self.show()
        self.show()


def looked(previewer: Previewer, sentence: str, camera: Camera) -> np.ndarray:
    """A picture (h w 3, uint8) of what a sentence makes about of the scene."""
    reading = read(sentence)
    if not previewer.is_exact(reading):
        return previewer.picture(reading, camera)
    made = previewer.glimpse(reading, camera) or previewer.scene(reading, camera).scene
    return eight_bits(render_picture(made, camera))
