"""Anchors: what moves is drawn back to where it was, the more the longer an edit goes on."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from tiny_edits import SETTINGS, run

from gsedit.fitting.anchors import LAMBDAS, growth
from gsedit.fitting.optimiser import SceneOptimiser, _parts
from gsedit.strategies.sds import Sds
from gsedit.strategies.single_pass import SinglePass
from rasterizer.scene import Gaussians

RATES = {"sh": 2.5e-2, "logit_opacities": 5e-3, "means": 1e-3}


def cloud(count=10, bands=4):
    random = torch.Generator().manual_seed(0)
    draw = lambda *shape: torch.randn(*shape, generator=random)  # noqa: E731
    return Gaussians(
        draw(count, 3), draw(count, 4), draw(count, 3), draw(count), draw(count, bands, 3)
    )


def away(scene):
    """A loss that pushes every value that moves to one side."""
    return -(scene.sh.sum() + scene.logit_opacities.sum() + scene.means.sum())


def test_the_weight_grows_by_generations_and_has_an_end():
    assert growth(0) == growth(99) == 0.05
    assert growth(100) == pytest.approx(0.065)
    assert growth(250) == pytest.approx(0.05 * 1.3**2)
    assert growth(10_000) == 10


def test_the_gradient_is_that_of_the_penalty(monkeypatch):
    start = cloud()
    optimiser = SceneOptimiser(start, RATES, anchor_weight=7.0)
    only = torch.arange(10) < 6
    away(optimiser.scene).backward()
    optimiser.step(only=only)
    given = {}
    adam_step = type(optimiser._adam).step
    monkeypatch.setattr(
        type(optimiser._adam),
        "step",
        lambda self, values, gradients, rates, rows: (
            given.update({k: v.clone() for k, v in _parts(gradients).items()}),
            adam_step(self, values, gradients, rates, rows),
        ),
    )
    here = optimiser.scene.detach().map(torch.clone)
    away(optimiser.scene).backward()
    optimiser.step(only=only)
    moved = {
        "sh": here.sh[only, :1] - start.sh[only, :1],
        "sh_rest": here.sh[only, 1:] - start.sh[only, 1:],
        "logit_opacities": here.logit_opacities[only] - start.logit_opacities[only],
        "means": here.means[only] - start.means[only],
    }
    for name, change in moved.items():
        change = change.clone().requires_grad_()
        (7.0 * growth(1) * LAMBDAS[name] * change.square().mean()).backward()
        torch.testing.assert_close(given[name][only], change.grad - 1)
        assert not given[name][~only].any()


def test_steps_of_some_rows_equal_steps_of_all():
    weight = torch.zeros(10)
    results = []
    for few in (False, True):
        optimiser = SceneOptimiser(cloud(), RATES, anchor_weight=50.0)
        for step in range(30):
            rows = torch.arange(step % 3, 10, 3)
            weight.zero_()[rows] = 1
            scene = optimiser.draw(rows) if few else optimiser.scene
            pushed = torch.ones(len(rows)) if few else weight
            (-(pushed[:, None, None] * scene.sh).sum()).backward()
            optimiser.step()
        results.append(optimiser.scene.sh.detach())
    torch.testing.assert_close(*results, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("strategy", [SinglePass(8), Sds(total_steps=10)])
def test_anchors_hold_every_strategy_back(strategy):
    settings = replace(SETTINGS, rounds=1)
    free, _ = run(strategy, settings)
    update = replace(SETTINGS.update, anchor_weight=1e6)
    held, _ = run(strategy, replace(settings, update=update))
    assert held.quality.strength < 0.5 * free.quality.strength
