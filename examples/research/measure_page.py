"""Frames a second of `gsedit app` over its websocket: `python examples/research/measure_page.py`.

Starts the page as a person does, opens one tab, and moves its camera about the scene.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from math import cos, sin
from pathlib import Path
from shutil import copy
from threading import Thread
from typing import Annotated

import numpy as np
import typer

from gsedit.app.loaded import read
from gsedit.app.previews import Previewer
from gsedit.app.reading import read as understand
from gsedit.app.shown import Shown, picture
from rasterizer.camera import Camera
from research.page_client import PageClient

SENTENCES = (
    "make it brighter", "paint it glossy red", "turn it into bronze", "make it night",
    "make it snow", "a thick layer of snow on it", "remove it", "make it half the size",
)  # fmt: skip
SIDE = 640
"""Longer side of the view of a preview, pixels."""
CAMERAS_A_SECOND = 60
"""Camera messages a second, as a browser sends them while one drags."""


@dataclass(frozen=True)
class Measured:
    """One run of a page."""

    gaussians: int
    size: tuple[int, int]
    first_picture: float
    """Seconds from the command to the first picture, the tab's own time included."""
    frames_a_second: float
    longer_side: float
    """Mean of the moving pictures, pixels."""
    rest: float
    """Seconds from the last camera to the full picture."""
    cpu_a_frame: float
    """Seconds of processor time of the page's process for a moving frame, all cores together."""
    peak_mb: float
    """Largest resident memory of the page's process."""
    waiting_mb: float
    """Largest resident memory of the process that waits for the first command."""


def measure(scene: Path, seconds: float, size: tuple[int, int]) -> Measured:
    """Run the page on a copy of a scene."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(copy(scene, folder))
        if (cameras := scene.with_name("cameras.json")).is_file():
            copy(cameras, folder)
        began = time.perf_counter()
        command = [sys.executable, "-m", "gsedit_cli", "app", str(place), "--no-browser", "--json"]
        page = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert page.stdout is not None
        try:
            tab = PageClient(json.loads(page.stdout.readline())["address"], size)
            tab.wait(lambda: tab.pictures, 120)
            first = tab.pictures[0][0] - began
            tab.wait(lambda: "Gaussians" in tab.text())
            count = int(tab.text().split(" Gaussians")[0].split()[-1].replace(",", ""))
            time.sleep(1.0)
            spent = cpu_seconds(page.pid)
            rate, side = turn(tab, seconds)
            spent = cpu_seconds(page.pid) - spent
            stopped = time.perf_counter()
            tab.wait(lambda: max(tab.pixels().shape) == max(size), 30)
            rest = tab.pictures[-1][0] - stopped
            peak = peak_memory(page.pid)
            waiting = max(map(peak_memory, children(page.pid)), default=0.0)
            tab.close()
        finally:
            page.terminate()
            page.wait()
    cpu = spent / max(rate * seconds, 1)
    return Measured(count, size, first, rate, side, rest, cpu, peak, waiting)


def turn(tab: PageClient, seconds: float) -> tuple[float, float]:
    """Move a tab's camera about its target; pictures a second and their mean longer side."""
    position, target = (np.array(tab.pose[name]) for name in ("position", "look_at"))
    arm, began = position - target, time.perf_counter()
    count, sides = len(tab.pictures), list[int]()
    known = count
    while (now := time.perf_counter() - began) < seconds:
        angle = 0.4 * sin(now)
        turned = np.array(
            [cos(angle) * arm[0] - sin(angle) * arm[1], sin(angle) * arm[0] + cos(angle) * arm[1]]
        )
        tab.look(position=(*(target[:2] + turned), target[2] + arm[2]))
        if len(tab.pictures) > known:
            known = len(tab.pictures)
            sides.append(max(tab.pixels().shape))
        time.sleep(1 / CAMERAS_A_SECOND)
    return (len(tab.pictures) - count) / seconds, float(np.mean(sides))


def peak_memory(process: int) -> float:
    """Largest resident memory of a process so far, MB; 0 where the system does not tell."""
    status = Path(f"/proc/{process}/status")
    lines = status.read_text().splitlines() if status.exists() else []
    return next((int(each.split()[1]) / 1024 for each in lines if each.startswith("VmHWM")), 0.0)


def cpu_seconds(process: int) -> float:
    """Processor time of a process so far, in and for it; 0 where the system does not tell."""
    stat = Path(f"/proc/{process}/stat")
    fields = stat.read_text().rpartition(")")[2].split() if stat.exists() else ["0"] * 13
    return sum(map(int, fields[11:13])) / os.sysconf("SC_CLK_TCK")


def children(process: int) -> list[int]:
    """The processes that a process has started."""
    told = Path(f"/proc/{process}/task/{process}/children")
    return [int(each) for each in told.read_text().split()] if told.exists() else []


def measure_previews(scene: Path) -> Iterator[str]:
    """Rows of a table: a sentence, and the seconds by the clock and of all cores from asking for
    its preview to its picture; where only the subject was found before, and where all that previews
    need was prepared."""
    loaded = read(scene)
    previewer, camera = Previewer(loaded, None), loaded.first_camera().fitted(SIDE)
    _ = previewer.finder.subject
    yield "| sentence | not prepared | prepared |\n|---|---:|---:|"
    behind = Thread(target=previewer.prepare)  # of its own: it takes a low priority
    behind.start()
    behind.join()
    for sentence in SENTENCES:
        prepared = timed(previewer, sentence, camera)
        kept = loaded.__dict__.pop("kept")
        fresh = timed(previewer, sentence, camera)
        loaded.__dict__["kept"] = kept
        yield f"| {sentence} | {fresh} | {prepared} |"


def timed(previewer: Previewer, sentence: str, camera: Camera) -> str:
    """Seconds by the clock, and of all cores, of one preview in one view."""
    clock, cpu, reading = time.perf_counter(), time.process_time(), understand(sentence)
    one_view = camera if previewer.is_partial(reading) else None
    picture(Shown(previewer.scene(reading, one_view).scene), camera)
    return f"{time.perf_counter() - clock:.2f} ({time.process_time() - cpu:.2f})"


def main(
    scene: Annotated[Path, typer.Argument(show_default=False, help="A scene (.ply).")],
    seconds: Annotated[float, typer.Option(help="Seconds of movement.")] = 10.0,
    width: int = 640,
    height: int = 480,
    previews: Annotated[bool, typer.Option(help="Time previews of sentences instead.")] = False,
) -> None:
    """Measure the page on one scene; prints JSON, or a table of previews."""
    if previews:
        for row in measure_previews(scene):
            typer.echo(row)
        return
    typer.echo(json.dumps(asdict(measure(scene, seconds, (width, height))), indent=2))


if __name__ == "__main__":
    typer.run(main)
