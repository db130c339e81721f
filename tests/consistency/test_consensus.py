"""Laws of agreement between views inside the sampler, at every solver and target.

What holds of the operator alone is in test_consensus_operator.py. The denoiser here knows one
Gaussian a view, so that every solver is an affine map of its start and the laws are exact up to
rounding.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import pytest
import torch
from sampler_runs import SD, SOLVERS, zero_terminal_snr

from gsedit.errors import UsageError
from gsedit.paper.consistency.consensus import consensus, share_noise
from gsedit.paper.diffusion.guidance import Branches, as_pair
from gsedit.paper.diffusion.sampler import Anchor, levels_of, sample
from gsedit.paper.diffusion.schedules import Schedule
from gsedit.paper.diffusion.settings import SamplerSettings

TARGETS = ("x0", "xt", "eps")
WIDTH = 0.3
LABELS = torch.tensor([[[0, 1, -1]], [[1, 2, -1]], [[2, 0, 1]]])  # clusters of 2, 3 and 2 cells
PAIRED = torch.tensor([[[0, 1, -1]], [[-1, 0, 1]]])
every_solver = pytest.mark.parametrize("solver", SOLVERS)
every_target = pytest.mark.parametrize("target", TARGETS)


def noise(*shape: int, seed: int = 0) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    return torch.randn(*shape, generator=generator, dtype=torch.float64)


@dataclass(frozen=True, eq=False)
class OneGaussian:
    """x0 of every view is normal about its own center; `condition` names the views."""

    centers: torch.Tensor
    name: str = "one Gaussian"
    schedule: Schedule = SD
    predicts: str = "x0"

    def branches(self, x, t, condition, need):
        level = self.schedule.level(t)
        center = self.centers[condition]
        shrunk = WIDTH**2 / (WIDTH**2 + level.sigma**2)
        x0 = center + shrunk * (x / level.a - center)
        return Branches(*(x0 if needed else None for needed in need))


def settings(solver: str, target: str = "x0", **more) -> SamplerSettings:
    return SamplerSettings(
        steps=6, solver=solver, target=target, spacing="linspace", t_end=0.0, strength=1.0, **more
    )


def states(model, x, chosen, labels=None, anchor=None, share=None):
    """Every state; fresh noise of one seed, shared where asked for."""
    agree = None
    if labels is not None:
        anchored = None if anchor is None else anchor.views
        agree = partial(consensus, labels=labels, anchored=anchored)
    views = torch.arange(len(x))
    views = views if anchor is None else views[~anchor.views]
    generator = torch.Generator().manual_seed(3)
    return [
        *sample(
            model, views, x, chosen,
            consensus=agree, share=share, anchor=anchor, generator=generator,
        )
    ]  # fmt: skip


def at(x: torch.Tensor, labels: torch.Tensor, cluster: int) -> torch.Tensor:
    """The cells of a cluster, [cells c]."""
    return x.movedim(1, -1)[labels == cluster]


@every_target
@every_solver
def test_views_that_agree_are_left_as_they_are(solver, target):
    """Idempotent: the same center, start and fresh noise at corresponding cells."""
    share = partial(share_noise, labels=LABELS)
    model, x = OneGaussian(share(noise(3, 2, 1, 3))), share(noise(3, 2, 1, 3, seed=1))
    chosen = settings(solver, target)
    alone = states(model, x, chosen, share=share)[-1].x
    torch.testing.assert_close(states(model, x, chosen, LABELS, share=share)[-1].x, alone)


@every_target
@every_solver
def test_sampling_with_consensus_is_linear(solver, target):
    """An affine denoiser gives for the mean of two starts (and centers) the mean of the results."""
    chosen = settings(solver, target)
    centers, starts = noise(2, 3, 2, 1, 3), noise(2, 3, 2, 1, 3, seed=1)

    def result(part: float) -> torch.Tensor:
        # fresh noise is the same in all three, so it is a constant of the affine map
        model = OneGaussian(torch.lerp(*centers, part))
        return states(model, torch.lerp(*starts, part), chosen, LABELS)[-1].x

    torch.testing.assert_close(result(0.3), torch.lerp(result(0.0), result(1.0), 0.3))


@every_target
@pytest.mark.parametrize("solver", ["ddim", "heun", "dpm++2m"])
def test_the_order_of_views_does_not_matter(solver, target):
    chosen, order = settings(solver, target), torch.tensor([2, 0, 1])
    centers, x = noise(3, 2, 1, 3), noise(3, 2, 1, 3, seed=1)
    straight = states(OneGaussian(centers), x, chosen, LABELS)[-1].x
    permuted = states(OneGaussian(centers[order]), x[order], chosen, LABELS[order])[-1].x
    torch.testing.assert_close(permuted, straight[order])


@every_solver
def test_two_views_take_exactly_their_mean(solver):
    model, x = OneGaussian(noise(2, 2, 1, 3)), noise(2, 2, 1, 3, seed=1)
    alone = states(model, x, settings(solver))[0]
    for target, field in (("x0", "x0"), ("xt", "x")):
        agreed = getattr(states(model, x, settings(solver, target), PAIRED)[0], field)
        for cluster in (0, 1):
            mean = at(getattr(alone, field), PAIRED, cluster).mean(0)
            torch.testing.assert_close(at(agreed, PAIRED, cluster), mean.expand(2, -1))
    first = levels_of(SD, settings(solver))[0]
    agreed = states(model, x, settings(solver, "eps"), PAIRED)[0]
    eps = as_pair("x0", agreed.x0, x, first).eps
    mean = at(as_pair("x0", alone.x0, x, first).eps, PAIRED, 0).mean(0)
    torch.testing.assert_close(at(eps, PAIRED, 0), mean.expand(2, -1))


@every_solver
def test_agreement_on_every_step_ends_in_agreement(solver):
    """x_{t-1} is the state itself; x0 and eps carry over where the noise is shared."""
    share = partial(share_noise, labels=LABELS)
    model, x = OneGaussian(noise(3, 2, 1, 3)), share(noise(3, 2, 1, 3, seed=1))
    for target in TARGETS:
        ended = states(model, x, settings(solver, target), LABELS, share=share)[-1].x
        for cluster in (0, 1, 2):
            cells = at(ended, LABELS, cluster)
            torch.testing.assert_close(cells, cells[:1].expand_as(cells))
        untouched = LABELS < 0
        assert len(at(ended, LABELS, -1)) == untouched.sum()
        assert (at(ended, LABELS, -1).diff(dim=0).abs() > 1e-3).all()


@every_target
@every_solver
def test_an_anchor_stays_and_leads(solver, target):
    """Its x0 is what it was at every step; its clusters end where it ends."""
    share = partial(share_noise, labels=LABELS)
    known = torch.tensor([True, False, False])
    answer = noise(3, 2, 1, 3, seed=5)
    x = share(noise(3, 2, 1, 3, seed=1))
    found = states(
        OneGaussian(noise(3, 2, 1, 3)), x, settings(solver, target), LABELS,
        anchor=Anchor(known, answer), share=share,
    )  # fmt: skip
    for state in found:
        torch.testing.assert_close(state.x0[0], answer[0])
    torch.testing.assert_close(found[-1].x[0], answer[0])
    torch.testing.assert_close(found[-1].x[2, :, 0, 1], answer[0, :, 0, 0])  # cluster 0
    torch.testing.assert_close(found[-1].x[1, :, 0, 0], answer[0, :, 0, 1])  # cluster 1
    # cluster 2 has no anchored cell: its two views agree with each other
    torch.testing.assert_close(found[-1].x[1, :, 0, 1], found[-1].x[2, :, 0, 0])


def test_shared_noise_keeps_the_variance_inside_a_view_and_independent_noise_does_not():
    """The contrast of a picture: what the paper's blur is about."""
    side, views = 40, 4
    columns = torch.arange(side)  # one further in each view: every cell is in one cluster of four
    shifted = torch.stack([columns.roll(v) for v in range(views)])
    labels = columns[:, None] * side + shifted[:, None, :]
    model = OneGaussian(torch.zeros(views, 2, side, side, dtype=torch.float64))
    x = noise(views, 2, side, side, seed=1)
    share = partial(share_noise, labels=labels)
    chosen = settings("ancestral", "xt")
    alone = states(model, x, chosen)[-1].x.std((1, 2, 3))
    shared = states(model, share(x), chosen, labels, share=share)[-1].x.std((1, 2, 3))
    lost = states(model, x, chosen, labels)[-1].x.std((1, 2, 3))
    # standard deviation of a standard deviation of 3200 numbers: 1.25 %; two of them, four sigma
    torch.testing.assert_close(shared, alone, rtol=0.07, atol=0)
    # every draw is averaged over four views, so half of the deviation is left
    torch.testing.assert_close(lost, alone / views**0.5, rtol=0.07, atol=0)


def test_eps_at_a_terminal_snr_of_zero_is_refused():
    model = replace(OneGaussian(noise(2, 2, 1, 3)), schedule=zero_terminal_snr(SD))
    chosen = settings("ddim", "eps")

    class AtInfinity(OneGaussian):
        def branches(self, x, t, condition, need):
            return Branches(self.centers[condition], *([None] * 2))

    chosen = replace(chosen, guidance_text=1.0, guidance_image=1.0)
    x = noise(2, 2, 1, 3, seed=1)
    model = AtInfinity(model.centers, schedule=model.schedule)
    assert states(model, x, replace(chosen, target="x0"), PAIRED)[-1].x.isfinite().all()
    with pytest.raises(UsageError, match="terminal SNR is 0"):
        states(model, x, chosen, PAIRED)
