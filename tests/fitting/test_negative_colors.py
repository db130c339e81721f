"""Colors below 0, which a renderer clamps, can be edited."""

from dataclasses import replace

import torch

from gsedit import View
from gsedit.bench.synthetic import demo_scene, ring_cameras, surface_gaussians
from gsedit.capture.fitting.optimizer import SceneOptimizer
from gsedit.capture.fitting.settings import UpdateSettings
from gsedit.capture.fitting.update import Target, rates, update_steps
from gsedit.measures.features import FilterBank
from rasterizer import render
from rasterizer.numerics import SH_DC


def blue(scene):
    return 0.5 + SH_DC * scene.sh[:, 0, 2]


def test_a_scene_whose_blue_is_negative_becomes_blue():
    scene = surface_gaussians(demo_scene(), 300, torch.Generator().manual_seed(0))
    yellow = replace(scene, sh=scene.sh.clone())
    yellow.sh[:, 0, 2] = (-0.2 - 0.5) / SH_DC
    camera = ring_cameras(demo_scene(), 1, 48)[0]
    with torch.no_grad():
        view = View("a", camera, render(scene, camera).color.clamp(0, 1))
    optimizer = SceneOptimizer(yellow, rates("appearance", 1.0))
    seen = torch.zeros(len(scene), dtype=torch.bool)
    seen[::2] = True
    settings = UpdateSettings(patches=1, patch=48)
    generator = torch.Generator().manual_seed(0)
    list(
        update_steps(
            optimizer, [Target(view)], seen, range(20), 20, settings, FilterBank(), generator
        )
    )
    after = blue(optimizer.scene.detach())
    assert after[seen].max() > 0.05  # 20 steps of Adam move a color by 0.08; it was -0.2
    torch.testing.assert_close(after[~seen], blue(yellow)[~seen])  # the others do not move
