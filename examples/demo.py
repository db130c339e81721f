"""Edit the built-in scene from a sentence and leave the pictures to look at: `make demo`."""

from __future__ import annotations

import sys
from pathlib import Path

import torch
from gsedit_cli.main import app

import gsedit
from gsedit.bench.synthetic import demo_scene, surface_gaussians

INSTRUCTION = "like Van Gogh"


def demo(folder: Path, count: int = 30_000, size: int = 256) -> None:
    """Make the scene and edit it as the command line does; exits with that command's code."""
    scene = surface_gaussians(demo_scene(), count, torch.Generator().manual_seed(0))
    source = folder.with_name(folder.name + "_scene.ply")
    gsedit.save(scene, source, overwrite=True)
    request = ["edit", str(source), INSTRUCTION, "-o", str(folder), "--size", str(size)]
    # z is up here; take all rounds, so that every small part is seen
    app([*request, "--up", "z", "--set", "coverage=1", "--force"])


if __name__ == "__main__":
    demo(Path(sys.argv[1] if len(sys.argv) > 1 else "out/demo"))
