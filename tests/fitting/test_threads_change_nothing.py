"""With the compiled kernel a fit and an update give the same bits on any number of threads.

The scene has more rows than torch gives to one thread (32,768), and the pictures more values.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import pytest
import torch
from small_scenes import traced_dataset

from gsedit import FitSettings, fit
from gsedit.bench.synthetic import demo_scene, ring_cameras, surface_gaussians
from gsedit.capture.fitting.optimizer import SceneOptimizer
from gsedit.capture.fitting.settings import UpdateSettings
from gsedit.capture.fitting.update import Target, rates, update_steps
from gsedit.measures.features import FilterBank
from rasterizer import Execution
from rasterizer.blending.choose import is_compiled

ROWS, THREADS = 33_209, 3  # of which none has the same share
COMPILED = Execution(kernel="compiled")


@pytest.fixture
def kernel():
    if not is_compiled(Execution()):
        pytest.skip("no C++ compiler on this machine")


@cache
def start():
    random = torch.Generator().manual_seed(0)
    few = surface_gaussians(demo_scene(), 1000, random)
    many = few[torch.arange(ROWS) % 1000]
    moved, faded = (torch.randn(each.shape, generator=random) for each in (many.means, many.sh))
    logits = many.logit_opacities + faded[:, 0, 0]
    return replace(many, means=many.means + 0.02 * moved, logit_opacities=logits)


@cache
def photos():
    scene = demo_scene()
    return traced_dataset(scene, ring_cameras(scene, 2, 110))


@cache
def fitted(threads: int):
    torch.set_num_threads(threads)
    settings = FitSettings(
        steps=5, seconds=None, coarse=(), densify_every=2, exposure="on", execution=COMPILED
    )
    return fit(photos(), settings, start=start())


@cache
def updated(threads: int):
    torch.set_num_threads(threads)
    optimizer = SceneOptimizer(start(), rates("appearance", 1.0), compiled=True)
    targets = [Target(replace(v, image=1 - v.image)) for v in photos().views]
    losses = update_steps(
        optimizer, targets, torch.ones(ROWS, dtype=torch.bool), range(2), 2, UpdateSettings(),
        FilterBank(), torch.Generator().manual_seed(0),
    )  # fmt: skip
    return list(losses), optimizer.scene.detach()


def same(one, other) -> bool:
    return all(torch.equal(a, b) for a, b in zip(vars(one).values(), vars(other).values()))


def test_a_fit(kernel):
    one, more = fitted(1), fitted(THREADS)
    assert len(one.scene) != ROWS  # it was densified
    assert same(one.scene, more.scene)
    assert one.psnr == more.psnr


def test_an_update(kernel):
    (losses, scene), (more_losses, more_scene) = updated(1), updated(THREADS)
    assert losses == more_losses
    assert same(scene, more_scene)
