"""Editing, fitting, capturing and the page need nothing that an extra brings."""

import subprocess
import sys

from gsedit.run.environment import EXTRAS

OF_NETWORKS = ("diffusers", "transformers", "accelerate", "openvino", "stlpips_pytorch", "sympy")
"""The last is of torch's compiler, which takes more than half a second to load."""
BARE = """
import contextlib, importlib, pkgutil, sys

class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in ABSENT:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

ABSENT = sys.argv[1].split(",")
sys.meta_path.insert(0, Absent())
for room in ("app", "capture", "editing"):
    found = importlib.import_module(f"gsedit.{room}")
    for module in pkgutil.walk_packages(found.__path__, f"gsedit.{room}."):
        importlib.import_module(module.name)

import torch
import gsedit
from gsedit.pictures.viewer.libraries import import_viser
from gsedit.bench.synthetic import demo_scene, ring_cameras, surface_gaussians
from gsedit.views.cameras_json import write_cameras
from gsedit.views.viewpoints import Viewpoint
from gsedit_cli.main import main

import_viser()
gsedit.save(surface_gaussians(demo_scene(), 1000, torch.Generator().manual_seed(0)), "a.ply")
ring = enumerate(ring_cameras(demo_scene(), 2, 64))
write_cameras([Viewpoint(str(i), each) for i, each in ring], "cameras.json")
for words in (["render", "a.ply", "-o", "shown"], ["edit", "a.ply", "paint it red", "-o", "out"]):
    sys.argv = ["gsedit", *words, "--size", "64"]
    with contextlib.suppress(SystemExit):
        main()
"""


def test_the_core_works_without_any_extra(tmp_path):
    absent = ",".join((*EXTRAS, *OF_NETWORKS))
    done = subprocess.run(
        [sys.executable, "-c", BARE, absent],
        cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "out/scene.ply").stat().st_size > 0
    assert len([*(tmp_path / "shown").iterdir()]) == 2
