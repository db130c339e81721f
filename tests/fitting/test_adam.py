"""A step is that of torch's Adam; an optimizer goes on from its state."""

import pytest
import torch

from gsedit.capture.fitting import adam
from gsedit.capture.fitting.optimizer import SceneOptimizer
from rasterizer import Gaussians

RATES = {"sh": 2.5e-2, "logit_opacities": 5e-3}


def cloud(count=12, bands=4):
    random = torch.Generator().manual_seed(0)
    draw = lambda *shape: torch.randn(*shape, generator=random)  # noqa: E731
    return Gaussians(
        draw(count, 3), draw(count, 4), draw(count, 3), draw(count), draw(count, bands, 3)
    )


def run(optimizer, steps, only=None):
    """Steps of a loss with a gradient in every coefficient and opacity but the last row's."""
    weight = torch.linspace(2, 0.1, len(optimizer))
    weight[-1] = 0
    for step in steps:
        scene = optimizer.scene
        loss = (weight[:, None, None] * (scene.sh - 1).square()).sum()
        (loss + (weight * scene.logit_opacities.square()).sum()).backward()
        optimizer.step(1 - 0.9 * step / 60, only=only)


def test_rows_outside_and_rows_without_a_gradient_stay():
    scene = cloud()
    optimizer = SceneOptimizer(scene, RATES)
    run(optimizer, range(20), only=torch.arange(len(scene)) % 4 > 0)
    moved = (optimizer.scene.sh - scene.sh).abs().amax((1, 2)) > 0
    assert moved.tolist() == [i % 4 > 0 and i < 11 for i in range(12)]


@pytest.mark.parametrize("compiled", [False, True])
def test_a_step_is_that_of_torch(compiled):
    if compiled and adam.load() is None:
        pytest.skip("no C++ compiler on this machine")
    scene = cloud()
    optimizer = SceneOptimizer(scene, {"means": 0.1}, compiled=compiled)
    leaf = scene.means.clone().requires_grad_()
    theirs = torch.optim.Adam([leaf], lr=0.1, eps=1e-15)
    for power in (2, 3, 2, 4):
        for values in (optimizer.scene.means, leaf):
            values.pow(power).sum().backward()
        optimizer.step()
        theirs.step()
        theirs.zero_grad()
    torch.testing.assert_close(optimizer.scene.means, leaf)


def test_an_optimizer_goes_on_from_its_state():
    scene = cloud()
    whole, first, second = (SceneOptimizer(scene, RATES) for _ in range(3))
    run(whole, range(30))
    run(first, range(17))
    second.load_state({name: value.clone() for name, value in first.state().items()})
    run(second, range(17, 30))
    assert torch.equal(whole.scene.sh, second.scene.sh)
    with pytest.raises(ValueError, match="sh of shape"):
        SceneOptimizer(cloud(7), RATES).load_state(first.state())


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_the_kernel_does_what_torch_does(dtype):
    if adam.load() is None:
        pytest.skip("no C++ compiler on this machine")
    scene = cloud(5000).to(dtype)  # enough for several threads
    by_torch, by_kernel = (SceneOptimizer(scene, RATES, compiled=c) for c in (False, True))
    for optimizer in (by_torch, by_kernel):
        run(optimizer, range(6))
    bar = 1e-12 if dtype == torch.float64 else 2e-6
    state, wanted = by_kernel.state(), by_torch.state()
    assert state.keys() == wanted.keys()
    for name, value in wanted.items():
        largest = float(value.abs().max())
        torch.testing.assert_close(state[name], value, rtol=bar, atol=bar * largest)


@pytest.mark.parametrize("name", ["first.sh", "second.sh", "value.sh", "steps"])
@pytest.mark.parametrize("kind", ["rows", "dtype", "nan", "missing"])
def test_a_state_of_another_shape_or_type_is_refused(name, kind):
    """The kernel gets addresses: it would write beside moments that are too small."""
    first, second = (SceneOptimizer(cloud(), RATES, compiled=True) for _ in range(2))
    run(first, range(3))
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
