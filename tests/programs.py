"""Programs that the command editor runs in tests."""

from __future__ import annotations

import time
from pathlib import Path

import pytest
import torch

from gsedit.paper.diffusion.settings import SamplerSettings
from gsedit.paper.editors import EditBatch
from gsedit.paper.editors.command import Command

APART = SamplerSettings(consensus=False)
INVERT = """
import sys
from pathlib import Path
from PIL import Image, ImageOps
source, target = map(Path, sys.argv[1:3])
for path in sorted(source.iterdir()):
    ImageOps.invert(Image.open(path)).save(target / path.name)
"""


def batch(views: int = 2, prompt: str = "make it snow", **more) -> EditBatch:
    g = torch.Generator().manual_seed(0)
    levels = torch.randint(256, (2, views, 6, 8, 3), generator=g)  # 8 bits: PNGs lose nothing
    return EditBatch(levels[0] / 255, levels[1] / 255, prompt, **more)


def run(editor: Command, request: EditBatch | None = None, settings=APART) -> torch.Tensor:
    *_, last = editor.edit(request or batch(), settings, torch.Generator())
    assert last.images is not None
    return last.images


def leftovers(tmp_path: Path) -> list[Path]:
    return sorted(p for p in (tmp_path / "exchange").rglob("*.png"))


CHILD = """
import subprocess, sys, time
child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
open({pids!r}, "w").write(f"{{child.pid}} ")
import os
open({pids!r}, "a").write(f"{{os.getpid()}}\\n")
time.sleep(60)
"""


def ended(pids: list[int]) -> bool:
    """Whether none of these processes runs any more (a zombie has ended)."""
    for _ in range(100):
        running = [pid for pid in pids if runs(pid)]
        if not running:
            return True
        time.sleep(0.05)
    return False


def runs(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0]
    except OSError:
        return False
    return state != "Z"


needs_proc = pytest.mark.skipif(not Path("/proc/self").exists(), reason="looks at processes")
