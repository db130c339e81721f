"""Pages of `gsedit app` for tests, whose worker takes no time to start."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from gsedit.app.page import Page
from gsedit.app.places import Places
from gsedit.app.server import Served, serve
from gsedit.app.worker import Worker

COMMAND = """
import json, shutil, sys, time
from pathlib import Path
line = sys.stdin.readline()
if not line: sys.exit()
verb, scene, *rest = json.loads(line)
if "--seconds" in rest: time.sleep(float(rest[rest.index("--seconds") + 1]))
if "--fail" in rest:
    error = {"type": "error", "what": "no such thing", "move": "focal", "values": {}}
    sys.exit(print(json.dumps(error)) or 2)
event = {"type": "event", "stage": "fit", "seconds": 0.1, "step": 1, "steps": 2}
print(json.dumps(event), flush=True)
out = Path(rest[rest.index("-o") + 1] if "-o" in rest else rest[0])
file = out / "scene.ply" if verb == "edit" else out
file.parent.mkdir(parents=True, exist_ok=True)
shutil.copyfile(scene, file)
print(json.dumps({"type": "result", "scene": str(file)}), flush=True)
"""
"""A program that copies the scene, for commands whose own work is tested elsewhere."""


def make_page(folder: Path, program: tuple[str, ...] = (sys.executable, "-Sc", COMMAND)) -> Page:
    """A page that is not served."""
    return Page(Worker(program), Places((folder.resolve(),)))


@contextmanager
def served(page: Page) -> Iterator[Served]:
    """A page at a free port."""
    with serve(page, port=0) as found:
        yield found


def until(happened: Callable[[], Any], seconds: float = 20.0) -> None:
    """Wait until something holds."""
    ends = time.monotonic() + seconds
    while not happened():
        assert time.monotonic() < ends
        time.sleep(0.01)
