"""The interval of a number that is pooled over views: a bootstrap that draws whole views.

Pixels, points and pairs of one view share its exposure, its noise and its place, so they are not
independent: views are drawn, and what belongs to a view comes with it. The interval tells how far
the number would move with other views of the same scene and edit, not with another seed or scene.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float

Interval = tuple[float, float]
"""The middle 95 % of the draws, and more where views are few."""
FEWEST_VIEWS = 4
"""Fewest views that have an interval: three can be drawn in ten ways only."""


def interval(
    sums: Sequence[Sequence[float | int]],
    views: Sequence[Sequence[int]],
    value: Callable[[Float[np.ndarray, "k d"]], Float[np.ndarray, " d"]],
) -> Interval | None:
    """The interval of value(total of `sums`); None below FEWEST_VIEWS views.

    A row of `sums` is the part of what belongs to the same row of `views`: one view, or the two of
    a pair, which comes as often as the product of its views' draws (Snijders and Borgatti 1999).
    `value` gets the `k` columns of sums, each for `d` draws. The same input has the same interval.
    """
    known = {view: k for k, view in enumerate(sorted({v for row in views for v in row}))}
    if len(known) < FEWEST_VIEWS:
        return None
    random = np.random.default_rng(0)
    # more than 2,000 draws move the ends by less than a hundredth of the length
    drawn = random.multinomial(len(known), np.full(len(known), 1 / len(known)), 2000)
    times = np.stack([drawn[:, [known[v] for v in row]].prod(1) for row in views], 1)
    times = times[times.any(1)]  # draws in which no pair has both of its views tell nothing
    tail = tail_of(len(known))
    drawn_values = value((times @ np.asarray(sums, float)).T)
    low, high = np.quantile(drawn_values, [tail, 1 - tail])
    return float(low), float(high)


def tail_of(units: int) -> float:
    """The share of draws beyond each end of an interval, where so many units, 2 or more, are drawn.

    Expanded percentiles (Hesterberg 2015): plain ones of few units are too narrow, by
    sqrt((n - 1) / n) and as the normal distribution is to Student's t.
    """
    from scipy.special import ndtr, stdtrit  # scipy.stats takes 0.3 s and 45 MB to import

    wide = np.sqrt(units / (units - 1)) * stdtrit(units - 1, 0.975)
    return float(ndtr(-wide))


def mean_interval(values: Sequence[float]) -> Interval | None:
    """The interval of a mean over views, one value each."""
    rows = [(value, 1.0) for value in values]
    return interval(rows, [(i,) for i in range(len(rows))], lambda sums: sums[0] / sums[1])
