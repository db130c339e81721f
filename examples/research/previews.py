"""Seconds of the page's previews, and how near they are to the edit:
`python -m research.previews SCENE > ../docs/measurements/data/app-previews.csv`.
"""

from __future__ import annotations

import time
from pathlib import Path
from threading import Thread
from typing import Annotated

import numpy as np
import typer

from gsedit.app.frames import DisplayState, picture
from gsedit.app.loaded import read
from gsedit.app.previews import Previewer
from gsedit.app.reading import read as understand
from rasterizer.scene import Gaussians

SENTENCES = (
    "make it brighter", "paint it red", "paint it glossy red", "turn it into bronze",
    "turn it into glass", "turn it into wood", "cover it with moss", "make it night",
    "make it snow", "a thick layer of snow on it", "remove it", "make it half the size",
)  # fmt: skip
HEADER = "sentence,glimpse (s of the processor),the view,the view by the clock,dB to the edit"
SIDE = 892
"""Longer side of the view, pixels: beside the panel of a window of 1280 by 720."""


def main(scene: Annotated[Path, typer.Argument(show_default=False)]) -> None:
    """Print a table of a scene whose previews were prepared, as the page does behind."""
    loaded = read(scene)
    previewer, first = Previewer(loaded, None), loaded.first_camera()
    camera = first.resized(SIDE, round(SIDE * first.height / first.width))
    _ = previewer.finder.subject
    behind = Thread(target=previewer.prepare)
    behind.start()
    behind.join()

    def drawn(made: Gaussians) -> np.ndarray:
        return picture(DisplayState(made), camera).astype(float)

    typer.echo(HEADER)
    for sentence in SENTENCES:
        reading, began, clock = understand(sentence), time.process_time(), time.perf_counter()
        previewer.glimpse(reading, camera)
        glimpse, partial = time.process_time() - began, previewer.is_partial(reading)
        view = drawn(previewer.scene(reading, camera if partial else None).scene)
        times = (glimpse, time.process_time() - began, time.perf_counter() - clock)
        error = np.square(view - drawn(previewer.scene(reading).scene)).mean() if partial else 0
        near = f"{10 * np.log10(255**2 / error):.1f}" if error else "the same"
        typer.echo(",".join((sentence, *(f"{each:.2f}" for each in times), near)))


if __name__ == "__main__":
    typer.run(main)
