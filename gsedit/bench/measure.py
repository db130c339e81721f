"""Time of a piece of work, and the yardstick that it is quoted in.

The yardstick Y is the time in which this machine, with the threads it has at that moment, does the
arithmetic of blending for 25 million float32 pixel-Gaussian pairs: a matrix product of inner size
6, an exponential and four products a pair, in pieces of 2^18 pairs that stay in cache. A single
operation would measure the maker's library: torch.exp takes five times as long on one maker's
processor as on another's, where the renderer does not. A pass is taken before every timed run, so
that a busy neighbor slows both; a Timing quotes the medians of the two.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from math import inf
from typing import Any, TypeVar

import torch
from jaxtyping import Float
from torch import Tensor

GAUSSIANS, PIXELS = 4096, 64
"""Size of a piece: 2^18 pairs, 1 MB read and 1 MB written, which two cores keep in their caches."""
PIECE = GAUSSIANS * PIXELS
PAIRS = 25_000_000
"""Pairs of the yardstick: as many as take the time of 10^8 exponentials on the Intel processor on
which the targets were set (8.7 ms against 8.5 ms, two threads of a Sapphire Rapids)."""
PIECES = PAIRS // PIECE
"""Whole pieces of a pass; the time of the missing part of a piece is added in proportion."""
QUICK_PIECES = PIECES // 10
PRODUCTS = 4
"""Elementwise products a pair: alpha, transmittance, weight and a gradient's factor."""


@dataclass(frozen=True)
class Timing:
    """Medians of some runs, seconds."""

    wall: float
    cpu: float
    """Processor time of all threads together."""
    runs: int
    yardstick: float
    """Median wall clock of the passes between the runs."""


@cache
def _piece() -> tuple[
    Float[Tensor, "n 6"], Float[Tensor, "6 p"], Float[Tensor, "n p"], Float[Tensor, "n p"]
]:
    """Quadratic forms of n Gaussians, monomials of p pixels, factors, and a buffer for the result;
    no number is denormal.
    """
    generator = torch.Generator().manual_seed(0)
    forms = -8 / 6 * torch.rand(GAUSSIANS, 6, generator=generator)  # exponents in (-8, 0]
    monomials = torch.rand(6, PIXELS, generator=generator)
    factors = 0.5 + 0.5 * torch.rand(GAUSSIANS, PIXELS, generator=generator)
    return forms, monomials, factors, torch.empty_like(factors)


def yardstick(pieces: int = PIECES) -> float:
    """Wall clock of one pass, seconds per `PAIRS` pairs; fewer pieces: quicker and less exact."""
    forms, monomials, factors, result = _piece()
    began = time.perf_counter()
    for _ in range(pieces):
        torch.mm(forms, monomials, out=result).exp_()
        for _ in range(PRODUCTS):
            result.mul_(factors)
    return (time.perf_counter() - began) * PAIRS / (pieces * PIECE)


Name = TypeVar("Name", str, int)


def timed(
    work: Callable[[], Any], runs: int = 5, budget: float = inf, pieces: int = PIECES
) -> tuple[Timing, Any]:
    """Medians of `runs` after a warm-up, and the result of the last run.

    No run begins once `budget` seconds are spent. Where the warm-up alone spends them, it is the
    one run that counts: slow work is not run twice.
    """
    timings, results = timed_together({"": work}, runs, budget, pieces)
    return timings[""], results[""]


def timed_together(
    works: Mapping[Name, Callable[[], Any]],
    runs: int = 5,
    budget: float = inf,
    pieces: int = PIECES,
) -> tuple[dict[Name, Timing], dict[Name, Any]]:
    """Timings and last results of works that take turns: a machine that slows down slows all."""
    began = time.perf_counter()
    samples: dict[Name, list[tuple[float, float, float]]] = {name: [] for name in works}
    results: dict[Name, Any] = {}
    for turn in range(runs + 1):
        if turn and time.perf_counter() - began > budget:
            break
        for name, work in works.items():
            unit = yardstick(pieces)
            results.pop(name, None)  # memory of the run before must not weigh on this one
            wall, cpu = time.perf_counter(), time.process_time()
            results[name] = work()
            sample = (time.perf_counter() - wall, time.process_time() - cpu, unit)
            samples[name].append(sample)
    return {name: _medians(taken) for name, taken in samples.items()}, results


def _medians(samples: list[tuple[float, float, float]]) -> Timing:
    counted = samples[1:] or samples
    wall, cpu, unit = (statistics.median(column) for column in zip(*counted))
    return Timing(wall, cpu, len(counted), unit)
