"""Materials, lights and styles as pictures of the user's own scene, made behind all other work."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from html import escape
from io import BytesIO
from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import Image

from gsedit.app.previews import Previewer
from gsedit.app.reading import read
from gsedit.app.steps import region_file
from gsedit.app.tab import button
from gsedit.errors import GseditError
from gsedit.formats.pictures import eight_bits
from gsedit.scene.merging import coarsen
from gsedit.scene.picture import render_picture

if TYPE_CHECKING:
    from gsedit.app.page import Page
    from gsedit.app.tab import Tab

LOOKS = {
    "bronze": "turn it into bronze", "gold": "turn it into gold",
    "marble": "turn it into marble", "glass": "turn it into glass",
    "night": "make it night", "sunset": "make it sunset", "fog": "make it foggy",
    "snow": "make it snow", "autumn": "autumn", "Van Gogh": "in the style of Van Gogh",
    "watercolor": "in the style of watercolor", "sketch": "in the style of a pencil sketch",
}  # fmt: skip
"""Names of the looks that are shown, and their sentences."""
PIXELS, GAUSSIANS = 112, 20_000
"""Longer side of a picture, and Gaussians that it is made of: more are not seen in it."""


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

    def make(self, previewer: Previewer, wanted: Callable[[], bool]) -> None:
        """Make the pictures that are missing, of the scene as it is now, while it is `wanted`;
        of a merged one, which is quick."""
        with self.page.drawing:
            self.draw(previewer, wanted)

    def draw(self, previewer: Previewer, wanted: Callable[[], bool]) -> None:
        """Make them, as the only thread that does."""
        page, pictures = self.page, self.page.pictures
        missing = [name for name in LOOKS if name not in pictures]
        if not missing or page.folder is None or not wanted():
            return self.show()
        loaded = page.loaded
        merged = coarsen(loaded.scene, GAUSSIANS)
        subject = None
        with suppress(GseditError):
            subject = previewer.finder.subject.inside
        small = loaded
        if merged is not None:
            small = replace(loaded, scene=merged.scene)
            small.__dict__["viewpoints"] = loaded.viewpoints
            subject = None if subject is None else merged.majority(subject)
        file = None if subject is None or not subject.any() else region_file(subject, page.folder)
        camera = loaded.first_camera().fitted(PIXELS)
        makers = Previewer(small, None), Previewer(small, file)
        slow = lambda name: LOOKS[name].startswith("turn")  # noqa: E731 (reflections)
        for name in sorted(missing, key=slow):
            if not wanted():
                return
            with suppress(GseditError):
                pictures[name] = uri_of(looked(makers, LOOKS[name], camera))
            self.show()
        small.forget()


def looked(makers: tuple[Previewer, Previewer], sentence: str, camera: Any) -> np.ndarray:
    """A picture (h w 3, uint8) of a sentence, made for the whole scene or for its subject."""
    reading = read(sentence)
    whole = all(each.target == "scene" for each in reading.instruction.changes)
    maker = makers[0] if whole else makers[1]
    if not maker.is_exact(reading):
        return maker.picture(reading, camera)
    seen = camera if maker.is_partial(reading) else None
    return eight_bits(render_picture(maker.scene(reading, seen).scene, camera))
