"""From photos to an exported edit in the page: `python -m research.journey_page PHOTOS -o OUT`.

A headless Chromium with real mouse, key and drop events does what a new user does: drops the folder
of photos, makes a scene, types a sentence, previews, applies, undoes, redoes, exports. The page's
process is killed (SIGKILL) in the middle and started again. Writes a screenshot of each step and
journey.json with the seconds of each.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from shutil import copy
from typing import Annotated

import typer

from research.page_browser import CTRL, Window, browser

SIZE = (1280, 720)
FORMATS = {".ply": ".ply", ".spz": ".spz", "page": ".html"}
"""Beginnings of the choices under Export, and the suffixes of their files."""
LONGEST = 900.0
"""Seconds that a step may take."""


class Journey:
    """The page in a folder, its process, and the seconds of the steps so far."""

    def __init__(self, out: Path) -> None:
        self.out, self.place = out, out / "home"
        self.place.mkdir(parents=True, exist_ok=True)
        self.record = out / "journey.json"
        known = json.loads(self.record.read_text()) if self.record.exists() else {}
        self.seconds: dict[str, float] = known

    @contextmanager
    def page(self) -> Iterator[tuple[subprocess.Popen[str], Window]]:
        """A page that was started with nothing, and the window of a person on it."""
        command = [sys.executable, "-m", "gsedit_cli", "app", "--no-browser", "--json"]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=self.place)
        assert process.stdout is not None
        try:
            with browser() as opened:
                window = opened(json.loads(process.stdout.readline())["address"], SIZE)
                window.keep_downloads(self.out / "downloads")
                window.wait(lambda: "Open files" in window.text(), 60)
                yield process, window
        finally:
            process.terminate()
            process.wait()

    @contextmanager
    def step(self, window: Window, name: str) -> Iterator[None]:
        """Measure a step, and take a screenshot at its end, or at its failure."""
        began = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[name] = round(time.perf_counter() - began, 1)
            self.record.write_text(json.dumps(self.seconds, indent=1))
            window.sleep(0.7)  # the full picture
            window.screenshot(self.out / f"{len(self.seconds):02d}-{name.replace(' ', '-')}.png")


def begin(journey: Journey, photos: Path, kill_in: str) -> None:
    """Drop the photos, make a scene, and kill the page in the middle."""
    with journey.page() as (process, window):
        with journey.step(window, "open the page"):
            window.wait(lambda: "Nothing is open" in window.text())
        with journey.step(window, "drop the photos"):
            window.drop(photos)
            window.wait(lambda: "no scene yet" in window.text(), 120)
        word = {"capture": "matches", "fit": "fitting the scene: fit 3"}[kill_in]
        with journey.step(window, f"until it is killed in the {kill_in}"):
            window.press("Make a scene of the photos")
            window.wait(lambda: word in window.text(), LONGEST)
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
        window.sleep(1)
        window.screenshot(journey.out / "killed.png")


def go_on(journey: Journey) -> None:
    """Start the page again, and go on with what was interrupted until there is a scene."""
    with journey.page() as (_, window):
        with journey.step(window, "start again"):
            window.press("Go on with", begins=True)
            window.wait(lambda: "no scene yet" in window.text())
        with journey.step(window, "go on to the scene"):
            window.press("Go on with", begins=True)
            window.wait(lambda: "Gaussians" in window.text() and "Cancel" not in window.text(),
                        LONGEST)  # fmt: skip


def edit(journey: Journey, sentence: str) -> None:
    """Say a sentence: preview, apply, undo, redo."""
    with journey.page() as (_, window):
        with journey.step(window, "open the session"):
            window.press("Go on with", begins=True)
            window.wait(lambda: "Gaussians" in window.text(), 60)
        with journey.step(window, "type the sentence"):
            window.press("Say")
            window.type("say", sentence)
            window.wait(lambda: "about" in window.text(), LONGEST)
        with journey.step(window, "preview"):
            window.press("Preview")
            window.wait(lambda: "End the preview" in window.text(), 60)
            window.wait(lambda: "Working on" not in window.text(), LONGEST)
        with journey.step(window, "apply"):
            window.press("Apply")
            window.wait(lambda: f"{sentence} ·" in window.text(), LONGEST)
        with journey.step(window, "undo"):
            window.key("z", CTRL)
            window.wait(lambda: f"{sentence} ·" not in window.text())
        with journey.step(window, "redo"):
            window.key("y", CTRL)
            window.wait(lambda: f"{sentence} ·" in window.text())
        assert not window.errors, window.errors


def export(journey: Journey) -> None:
    """Export what was made, in each of FORMATS."""
    with journey.page() as (_, window):
        window.press("Go on with", begins=True)
        window.wait(lambda: "Gaussians" in window.text(), 60)
        window.press("File")
        for choice, suffix in FORMATS.items():
            with journey.step(window, f"export {suffix}"):
                window.choose("as", choice)
                window.press("Export")
                files = lambda: [  # noqa: E731
                    each
                    for each in (journey.out / "downloads").glob(f"*{suffix}")  # noqa: B023
                ]
                window.wait(files, LONGEST)
        assert not window.errors, window.errors


def main(
    photos: Annotated[Path, typer.Argument(show_default=False, help="Folder of photos.")],
    out: Annotated[Path, typer.Option("-o", help="Folder to write.")],
    every: Annotated[int, typer.Option(help="Take every so many of the photos.")] = 1,
    kill_in: Annotated[str, typer.Option(help="capture or fit.")] = "fit",
    sentence: str = "turn it into bronze",
    part: Annotated[int, typer.Option(help="1 to 4; 0: all.")] = 0,
) -> None:
    """Make the journey; prints the seconds of its steps."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # ends the page and the browser too
    journey = Journey(out)
    if part in (0, 1):
        folder = out / "photos"
        folder.mkdir(exist_ok=True)
        for each in sorted(photos.glob("*.jpg"))[::every]:
            copy(each, folder)
        begin(journey, folder, kill_in)
    if part in (0, 2):
        go_on(journey)
    if part in (0, 3):
        edit(journey, sentence)
    if part in (0, 4):
        export(journey)
    typer.echo(json.dumps({**journey.seconds, "minutes": round(total(journey), 1)}, indent=1))


def total(journey: Journey) -> float:
    """Minutes of all steps."""
    return sum(journey.seconds.values()) / 60


if __name__ == "__main__":
    typer.run(main)
