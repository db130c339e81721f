"""Timings are medians beside a yardstick; the machine and the commit are named."""

from __future__ import annotations

import os
from types import SimpleNamespace

import pytest
import torch

from gsedit.bench import measure, provenance


@pytest.fixture
def clock(monkeypatch):
    """Time stands still but for what is added to `now`; cpu time goes twice as fast."""
    state = SimpleNamespace(now=0.0)
    monkeypatch.setattr(measure.time, "perf_counter", lambda: state.now)
    monkeypatch.setattr(measure.time, "process_time", lambda: 2 * state.now)
    return state


def test_the_yardstick_is_the_time_of_the_arithmetic_of_25_million_pairs(monkeypatch, clock):
    sizes = []
    product = torch.mm

    def mm(a, b, out):
        clock.now += 1.0
        sizes.append((out.numel(), a.shape[1]))
        return product(a, b, out=out)

    monkeypatch.setattr(measure.torch, "mm", mm)
    seconds = measure.yardstick(pieces=4)
    assert sizes == [(2**18, 6)] * 4
    assert seconds == pytest.approx(25e6 / 2**18)  # a second a piece


def test_the_yardstick_meets_no_denormal_number():
    """They are five times slower on some processors, and its own."""
    measure.yardstick(pieces=1)
    *_, result = measure._piece()
    assert result.min() > torch.finfo(torch.float32).tiny
    assert result.max() <= 1


def works(clock, *durations):
    """Work that takes so long, one duration after the other, and gives the number of its run."""
    left = iter(enumerate(durations))

    def work():
        run, seconds = next(left)
        clock.now += seconds
        return run

    return work


def test_a_timing_is_the_median_without_the_warm_up(monkeypatch, clock):
    monkeypatch.setattr(measure, "yardstick", lambda _: 0.25)
    timing, result = measure.timed(works(clock, 100.0, 5.0, 1.0, 3.0), runs=3)
    assert timing == measure.Timing(3.0, 6.0, 3, 0.25)
    assert result == 3


def test_no_run_begins_once_the_budget_is_spent(monkeypatch, clock):
    monkeypatch.setattr(measure, "yardstick", lambda _: 0.25)
    timing, _ = measure.timed(works(clock, 1.0, 2.0, 2.0, 9.0), runs=3, budget=4.0)
    assert (timing.wall, timing.runs) == (2.0, 2)
    slow, _ = measure.timed(works(clock, 7.0), runs=3, budget=4.0)
    assert (slow.wall, slow.runs) == (7.0, 1)  # the warm-up is the run: slow work is not repeated


def test_compared_works_take_turns(monkeypatch):
    monkeypatch.setattr(measure, "yardstick", lambda _: 0.25)
    order = []
    jobs = {name: lambda name=name: order.append(name) for name in "ab"}
    timings, _ = measure.timed_together(jobs, runs=2)
    assert "".join(order) == "ababab"
    assert set(timings) == {"a", "b"}


def test_a_yardstick_pass_lies_between_the_runs(monkeypatch):
    order = []
    monkeypatch.setattr(measure, "yardstick", lambda _: order.append("y") or 1.0)
    measure.timed(lambda: order.append("w"), runs=2)
    assert "".join(order) == "ywywyw"


def test_machine_and_commit_are_words():
    assert f"{os.cpu_count()} cores, torch " in provenance.machine()
    assert provenance.commit().strip()
