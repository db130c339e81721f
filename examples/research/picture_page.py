"""Write a picture of `gsedit app`: `python examples/research/picture_page.py SCENE "SENTENCE"`.

Opens a copy of the scene in a headless Chromium, applies the sentence and compares by the wipe.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path
from shutil import copy
from typing import Annotated

import typer
from PIL import Image

from research.page_browser import browser

QUALITY = 88


def main(
    scene: Annotated[Path, typer.Argument(show_default=False, help="A scene (.ply).")],
    sentence: Annotated[str, typer.Argument(show_default=False, help="A sentence.")],
    out: Annotated[Path, typer.Option("-o", help="Picture to write (.jpg).")] = Path("page.jpg"),
    width: int = 1280,
    height: int = 720,
) -> None:
    """Write a picture of the page."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(copy(scene, folder))
        if (cameras := scene.with_name("cameras.json")).is_file():
            copy(cameras, folder)
        command = [sys.executable, "-m", "gsedit_cli", "app", str(place), "--no-browser", "--json"]
        page = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert page.stdout is not None
        try:
            with browser() as opened:
                window = opened(json.loads(page.stdout.readline())["address"], (width, height))
                window.wait(lambda: "Gaussians" in window.text(), 60)
                window.press("Say")
                window.write("", sentence)
                window.wait(lambda: "about" in window.text(), 60)
                window.press("Apply")
                window.wait(lambda: f"{sentence} ·" in window.text(), 300)
                window.press("History")
                window.press("wipe")
                window.sleep(8)
                window.screenshot(Path(folder, "page.png"))
        finally:
            page.terminate()
            page.wait()
        with Image.open(Path(folder, "page.png")) as picture:
            picture.convert("RGB").save(out, quality=QUALITY)


if __name__ == "__main__":
    typer.run(main)
