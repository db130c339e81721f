"""Studies of the sampler: what they measure, their table and their plots."""

import pytest
import torch
from closeness import slope
from research.sampler import consensus_study, solver_study
from research.sampler.mixtures import exact_solution
from research.sampler.overlapping import texture_views


@pytest.fixture(scope="module")
def solver_rows():
    with pytest.MonkeyPatch.context() as patch:  # the slow reference has its own test
        patch.setattr(solver_study, "exact_solution", lambda *a: exact_solution(*a, steps=500))
        return [*solver_study.solver_study((0.3,), (1.0,), (10, 20, 40, 80), runs=1)]


@pytest.fixture(scope="module")
def consensus_rows():
    return [*consensus_study.consensus_study(1, sweep=(0, 10, 50))]


def test_the_solvers_rows_fall_with_their_order(solver_rows):
    for solver, order in (("ddim", 1), ("heun", 2), ("dpm++2m", 2)):
        group = [row for row in solver_rows if row.variant == solver]
        assert [row.evaluations for row in group] == [10, 20, 40, 80]
        points = [(float(row.evaluations), row.error or 0.0) for row in group]
        # with few steps a second-order method's error falls faster yet, so from one side only
        assert slope(points) < -order + 0.3


def test_agreement_comes_with_contrast_and_strength(consensus_rows):
    by_variant = {
        r.variant: r for r in consensus_rows if r.problem == "texture" and r.t_end is None
    }
    paper, ours = by_variant["xt, independent (paper)"], by_variant["x0, shared (default)"]
    none = by_variant["none, independent noise"]
    # the mean of four independent draws has half their deviation; not all cells are in four views
    assert (paper.contrast or 0) < 0.75
    assert (ours.contrast or 0) > 0.9
    assert (ours.disagreement or 9) < (none.disagreement or 0)
    assert none.contrast == pytest.approx(1)
    whole = by_variant["x0, shared, to the end"]
    assert whole.disagreement == pytest.approx(0, abs=1e-3)
    assert (whole.contrast or 0) > 0.9


def test_the_deviation_falls_steadily_and_keeps_its_sign(consensus_rows):
    for variant in ("x0, shared (default)", "xt, shared"):
        swept = [
            row.deviation
            for row in consensus_rows
            if row.problem == "texture, T_end" and row.variant == variant
        ]
        assert swept[0] == pytest.approx(1)
        assert swept == sorted(swept, reverse=True)
        assert swept[-1] == pytest.approx(0, abs=1e-3)


def test_disagreement_is_that_of_a_plain_loop():
    views = texture_views(side=6, shift=1)
    x = torch.randn(4, 6, 6, 1, generator=torch.Generator().manual_seed(0))
    squares = []
    for cluster in range(int(views.clusters.max()) + 1):
        cells = x[views.clusters == cluster]
        if len(cells):
            squares.append(((cells - cells.mean(0)) ** 2).flatten())
    expected = torch.cat(squares).mean().sqrt().item()
    assert views.disagreement(x) == pytest.approx(expected, rel=1e-5)
    assert views.deviation(x, x) == pytest.approx(1)
    assert views.deviation(-0.5 * x, x) == pytest.approx(-0.5, rel=1e-5)
