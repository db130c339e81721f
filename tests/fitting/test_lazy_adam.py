"""A step over some rows is the step over all of them; an optimizer goes on from its state."""

from __future__ import annotations

import pytest
import torch

from gsedit.capture.fitting import lazy_adam
from gsedit.capture.fitting.optimizer import SceneOptimizer
from rasterizer import Gaussians

RATES = {"sh": 2.5e-2, "logit_opacities": 5e-3}


def cloud(count=12, bands=4):
    random = torch.Generator().manual_seed(0)
    draw = lambda *shape: torch.randn(*shape, generator=random)  # noqa: E731
    return Gaussians(
        draw(count, 3), draw(count, 4), draw(count, 3), draw(count), draw(count, bands, 3)
    )


def pull(scene, weight):
    """A loss with a gradient in every coefficient and opacity."""
    return (weight[:, None, None] * (scene.sh - 1).square()).sum() + (
        weight * scene.logit_opacities.square()
    ).sum()


def schedule(steps, count):
    """The rows of each step; the last row is in none, the first in few."""
    random = torch.Generator().manual_seed(1)
    for step in range(steps):
        rows = torch.randperm(count - 1, generator=random)[:5].sort().values
        yield step, rows if step % 9 == 0 else rows[rows > 0]


def run(optimizer, steps, *, few, only=None):
    weight = torch.linspace(0.1, 2, len(optimizer))
    for step, rows in steps:
        if few:
            loss = pull(optimizer.draw(rows), weight[rows])
        else:
            drawn = torch.zeros_like(weight)
            drawn[rows] = weight[rows]
            loss = pull(optimizer.scene, drawn)
        loss.backward()
        optimizer.step(1 - 0.9 * step / 60, only=only)


@pytest.fixture(params=["torch", "compiled"])
def compiled(request):
    if request.param == "compiled" and lazy_adam.load() is None:
        pytest.skip("no C++ compiler on this machine")
    return request.param == "compiled"


@pytest.mark.parametrize("limited", [False, True])
def test_steps_of_some_rows_equal_steps_of_all(limited, compiled):
    scene = cloud()
    only = torch.arange(len(scene)) % 4 > 0 if limited else None
    all_rows, some_rows = (SceneOptimizer(scene, RATES, compiled=compiled) for _ in range(2))
    run(all_rows, schedule(60, len(scene)), few=False, only=only)
    run(some_rows, schedule(60, len(scene)), few=True, only=only)
    one, other = all_rows.scene.detach(), some_rows.scene.detach()
    torch.testing.assert_close(one.sh, other.sh, rtol=2e-4, atol=2e-5)
    torch.testing.assert_close(one.logit_opacities, other.logit_opacities, rtol=2e-4, atol=2e-5)
    assert (one.sh - scene.sh).abs().amax() > 0.1
    assert torch.equal(other.sh[-1], scene.sh[-1])


def test_a_step_is_that_of_torch(compiled):
    scene = cloud()
    optimizer = SceneOptimizer(scene, {"means": 0.1}, compiled=compiled)
    leaf = scene.means.clone().requires_grad_()
    adam = torch.optim.Adam([leaf], lr=0.1, eps=1e-15)
    for power in (2, 3, 2, 4):
        for values in (optimizer.scene.means, leaf):
            values.pow(power).sum().backward()
        optimizer.step()
        adam.step()
        adam.zero_grad()
    torch.testing.assert_close(optimizer.scene.means, leaf)


def test_an_optimizer_goes_on_from_its_state():
    scene, steps = cloud(), list(schedule(30, 12))
    whole, first, second = (SceneOptimizer(scene, RATES) for _ in range(3))
    run(whole, steps, few=True)
    run(first, steps[:17], few=True)
    second.load_state({name: value.clone() for name, value in first.state().items()})
    run(second, steps[17:], few=True)
    torch.testing.assert_close(whole.scene.sh, second.scene.sh, rtol=2e-4, atol=2e-5)
    with pytest.raises(ValueError, match="sh of shape"):
        SceneOptimizer(cloud(7), RATES).load_state(first.state())


@pytest.mark.parametrize("few", [False, True])
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_the_kernel_does_what_torch_does(few, dtype):
    if lazy_adam.load() is None:
        pytest.skip("no C++ compiler on this machine")
    scene = cloud(5000).to(dtype)  # enough for several threads
    by_torch, by_kernel = (SceneOptimizer(scene, RATES, compiled=c) for c in (False, True))
    random = torch.Generator().manual_seed(2)
    steps = [(step, torch.randperm(5000, generator=random)[:3000].sort().values)
             for step in range(6)]  # fmt: skip
    for optimizer in (by_torch, by_kernel):
        run(optimizer, steps, few=few)
    bar = 1e-12 if dtype == torch.float64 else 2e-6
    torch.testing.assert_close(by_kernel.scene.sh, by_torch.scene.sh, rtol=bar, atol=bar)
    state, wanted = by_kernel.state(), by_torch.state()
    assert state.keys() == wanted.keys()
    for name, value in wanted.items():
        torch.testing.assert_close(
            state[name], value, rtol=bar, atol=bar * float(value.abs().max())
        )


@pytest.mark.parametrize("name", ["first.sh", "second.sh", "value.sh", "steps"])
@pytest.mark.parametrize("kind", ["rows", "dtype", "nan", "missing"])
def test_a_state_of_another_shape_or_type_is_refused(name, kind):
    """The kernel gets addresses: it would write beside moments that are too small."""
    first, second = (SceneOptimizer(cloud(), RATES, compiled=True) for _ in range(2))
    run(first, list(schedule(3, 12)), few=True)
    state = dict(first.state())
    spoil = {
        "rows": lambda value: value.reshape(-1)[:1],
        "dtype": lambda value: value.to(torch.float16),
        "nan": lambda value: torch.full_like(value, torch.nan if value.ndim else -1),
    }
    if kind == "missing":
        del state[name]
    else:
        state[name] = spoil[kind](state[name])
    if (name, kind) == ("first.sh", "missing"):
        return  # a field without a gradient has no moments
    with pytest.raises(ValueError, match=r"state has no|finite|none"):
        second.load_state(state)
