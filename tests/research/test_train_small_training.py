"""Training of the small editor: noise, loss, schedule, checkpoints."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch
from research.train_small.batches import training_batch
from research.train_small.loss import (
    HIGH_NOISE_SHARE,
    HIGH_NOISE_T,
    T_MAX,
    T_MIN,
    UNEDITED_T,
    noisy_targets,
    training_loss,
)
from research.train_small.picture_cache import Chunk
from research.train_small.pictures import procedural
from research.train_small.settings import Phase, TrainSettings
from research.train_small.sources import PackedSources, pack
from research.train_small.train import on_device, train
from research.train_small.training import TrainingState, train_steps
from small_networks import TINY, random_network

from gsedit.diffusion.sampler import levels_of
from gsedit.diffusion.settings import SamplerSettings
from gsedit.editors.small.denoiser import MID_SIGMA, load_small, schedule
from gsedit.editors.small.network import SmallNetwork
from gsedit.errors import GseditError, UsageError

FLOAT = TrainSettings(warm_up=20, precision=torch.float32)


def seeded(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


@pytest.fixture(scope="module")
def pictures() -> PackedSources:
    return pack(procedural(12, 48, seeded()))


def test_noise_levels_follow_the_schedule():
    targets, unedited = torch.zeros(4000, 1, 1, 1), torch.ones(4000, 1, 1, 1)
    sigma, x = noisy_targets(targets, unedited, seeded())
    t = 2 / math.pi * torch.atan(sigma / MID_SIGMA)
    assert t.min() + 1e-6 >= T_MIN
    assert t.max() <= T_MAX + 1e-6
    share = HIGH_NOISE_SHARE + (1 - HIGH_NOISE_SHARE) * (T_MAX - HIGH_NOISE_T) / (T_MAX - T_MIN)
    assert abs(float((t > HIGH_NOISE_T).float().mean()) - share) < 0.03
    b = sigma * (1 + sigma**2).rsqrt()
    low = t < 0.9
    assert abs(float((x.flatten()[low] / b[low]).std()) - 1) < 0.05


def test_half_of_the_noisiest_samples_start_from_the_unedited_picture():
    targets, unedited = torch.zeros(4000, 1, 1, 1), torch.ones(4000, 1, 1, 1)
    sigma, x = noisy_targets(targets, unedited, seeded())
    _, without = noisy_targets(targets, targets, seeded())
    a = (1 + sigma**2).rsqrt()
    visible = (x - without).flatten() / a
    high = 2 / math.pi * torch.atan(sigma / MID_SIGMA) > UNEDITED_T
    assert not visible[~high].any()
    started = visible[high] > 0.5
    torch.testing.assert_close(visible[high], started.float(), atol=1e-3, rtol=0)
    assert abs(float(started.float().mean()) - 0.5) < 0.05


def test_the_default_sampling_starts_where_the_training_does():
    assert levels_of(schedule(), SamplerSettings())[0].t > UNEDITED_T * 1000


def test_a_step_in_bfloat16_is_near_one_in_float32(pictures):
    torch.manual_seed(0)
    network, batch = SmallNetwork(TINY), training_batch(pictures, 32, 4, 2, seeded())
    exact, rounded = (
        training_loss(network, batch, seeded(), TrainSettings(precision=precision))
        for precision in (torch.float32, torch.bfloat16)
    )
    rounded.backward()
    assert all(p.grad is None or p.grad.isfinite().all() for p in network.parameters())
    torch.testing.assert_close(rounded, exact, rtol=0.03, atol=0)


def test_a_checkpoint_of_another_training_is_refused():
    one, other = (
        TrainingState(SmallNetwork(TINY), seeded(), TrainSettings(learning_rate=r))
        for r in (1e-3, 2e-3)
    )
    with pytest.raises(UsageError, match=r"of another training.*delete it, or take another folder"):
        other.load_state_dict(one.state_dict())


def test_train_continues_from_its_checkpoint(tmp_path):
    chunks, rounds = (
        (Chunk(3, 24, 4, 0),),
        [(Phase(16, 1, 2),), (Phase(16, 1, 2, rate_factor=0.5),)],
    )
    train(tmp_path, chunks, rounds, SmallNetwork(TINY))
    weights = tmp_path / "small.safetensors"
    first = load_small(weights).network.state_dict()
    weights.unlink()
    train(
        tmp_path, chunks, rounds, SmallNetwork(TINY)
    )  # finished: only the missing weights are written
    again = load_small(weights)
    assert all(
        torch.equal(value, first[name]) for name, value in again.network.state_dict().items()
    )
    assert "bronze" in again.words


def test_a_training_continues_exactly_where_it_stopped(pictures):
    def new_state() -> TrainingState:
        torch.manual_seed(0)
        return TrainingState(SmallNetwork(TINY), seeded(), FLOAT)

    rounds = [Phase(16, 2, 3), Phase(24, 1, 2)], [Phase(16, 1, 3)]
    whole, first, second = new_state(), new_state(), new_state()
    losses = [report.loss for report in train_steps(whole, pictures, *rounds)]
    steps = train_steps(first, pictures, *rounds)
    before = [next(steps).loss for _ in range(3)]
    second.load_state_dict(first.state_dict())
    after = [report.loss for report in train_steps(second, pictures, *rounds)]
    assert before + after == losses
    for one, two in zip(whole.average.parameters(), second.average.parameters()):
        assert torch.equal(one, two)


def test_a_phase_may_use_fewer_pictures(pictures):
    def loss(given: PackedSources, **options: int) -> float:
        torch.manual_seed(0)
        state = TrainingState(SmallNetwork(TINY), seeded(), FLOAT)
        return next(train_steps(state, given, [Phase(16, 1, 4, **options)])).loss

    assert loss(pictures, pictures=2) == loss(pictures.first(2)) != loss(pictures)


def test_the_rate_rises_and_falls_once_a_round(pictures):
    state = TrainingState(
        SmallNetwork(TINY), seeded(), TrainSettings(learning_rate=1e-3, warm_up=2)
    )
    rounds = [Phase(16, 3, 1), Phase(16, 1, 1)], [Phase(16, 4, 1, rate_factor=0.5)]
    rates = [state.optimizer.param_groups[0]["lr"] for _ in train_steps(state, pictures, *rounds)]
    assert rates == pytest.approx([5e-4, 1e-3, 1e-3, 5e-4, 2.5e-4, 5e-4, 5e-4, 2.5e-4])


def test_the_loss_falls_in_training():
    pictures = pack(procedural(8, 48, seeded()))
    torch.manual_seed(0)
    settings = TrainSettings(learning_rate=3e-3, warm_up=20, precision=torch.float32)
    state = TrainingState(
        SmallNetwork(replace(TINY, pixel_mlp=16, embedding=64)), seeded(), settings
    )
    losses = [report.loss for report in train_steps(state, pictures, [Phase(32, 60, 8)])]
    assert sum(losses[-10:]) < 0.7 * sum(losses[:10])


def test_a_loss_that_is_not_finite_ends_the_training(pictures):
    state = TrainingState(SmallNetwork(TINY), seeded(), FLOAT)
    with torch.no_grad():
        next(state.network.parameters()).fill_(math.nan)
    before = state.state_dict()["average"]
    with pytest.raises(GseditError, match=r"at step 1: lower the learning rate \(0\.001\)"):
        next(train_steps(state, pictures, [Phase(16, 1, 2)]))
    assert all(torch.equal(v, before[k]) or v.isnan().any() for k, v in before.items())
    assert state.step == 0


def test_a_device_that_there_is_not_is_refused():
    with pytest.raises(UsageError, match="--device xpu:9 cannot be used"):
        on_device(random_network(), "xpu:9")
