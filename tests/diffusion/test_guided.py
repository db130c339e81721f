"""Guidance that ends early, or that steps share: what is computed, and that it is the same."""

from dataclasses import replace

import pytest
import torch
from mixtures import mixture_problem, noised_draw
from sampler_runs import SOLVERS, UNGUIDED, generator, run

from gsedit.errors import UsageError
from gsedit.paper.consistency.consensus import consensus
from gsedit.paper.diffusion.guidance import branches_of
from gsedit.paper.diffusion.sampler import levels_of, sample
from gsedit.paper.diffusion.settings import SamplerSettings

GUIDED = replace(UNGUIDED, guidance_text=3.0, guidance_image=1.5, steps=6)


def counting(model):
    """(the model, a list of how many branches each call computes)."""
    calls = []
    kind = type(model)

    class Counting(kind):
        def branches(self, x, t, condition, need):
            calls.append(sum(need))
            return super().branches(x, t, condition, need)

    return Counting(**vars(model)), calls


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("spared", [{}, {"guidance_every": 2}, {"guidance_end": 1.0}])
def test_branches_are_those_that_were_foretold(solver, spared):
    model, calls = counting(mixture_problem(0.5))
    settings = replace(GUIDED, solver=solver, **spared)
    run(model, settings)
    assert calls == branches_of(levels_of(model.schedule, settings), settings)
    assert (sum(calls) < 3 * len(calls)) == bool(spared)


def test_guidance_that_has_ended_adds_nothing():
    model = mixture_problem(0.5)
    never = replace(GUIDED, guidance_end=1e6)
    assert torch.equal(run(model, never), run(model, replace(UNGUIDED, steps=6)))
    assert not torch.equal(run(model, GUIDED), run(model, never))


def test_shared_guidance_errs_less_than_none():
    model, guided = mixture_problem(0.5), replace(GUIDED, steps=20)
    full = run(model, guided)
    shared, none = (
        run(model, replace(guided, **spared)) - full
        for spared in ({"guidance_every": 2}, {"guidance_end": 1e6})
    )
    assert 0 < shared.norm() < 0.3 * none.norm()


def test_cells_that_agree_to_the_end_are_equal_whatever_is_spared():
    model, g = mixture_problem(0.5), generator()
    settings = replace(GUIDED, guidance_every=2, consensus=True, t_end=0.0)
    x = noised_draw(model, levels_of(model.schedule, settings)[0], dtype=torch.float64)
    views, _, rows, columns = x.shape
    labels = torch.arange(rows * columns).reshape(1, rows, columns).expand(views, -1, -1)
    *_, last = sample(
        model, None, x, settings, consensus=lambda z: consensus(z, labels=labels), generator=g
    )
    assert views > 1
    torch.testing.assert_close(last.x0, last.x0[:1].expand_as(last.x0))


def test_ranges_are_checked():
    for bad in ({"guidance_every": 0}, {"guidance_end": -1.0}):
        with pytest.raises(UsageError, match=next(iter(bad))):
            SamplerSettings(**bad)
