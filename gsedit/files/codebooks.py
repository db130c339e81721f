"""Values that share few: codebooks of numbers, palettes of vectors. numpy, deterministic.

`n` values or rows, `k` entries, `d` numbers a row.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, Int32, Shaped

CODES = 256
"""Of a codebook: an index is a byte."""
_BINS = 1 << 16
"""Of the histogram that stands for the values."""
_COARSE = 1 << 10
"""Of the coarser one, which tells how many values are near."""
_ROUNDS = 50
"""Of Lloyd's iteration, which moves little then."""


def codebook(values: Shaped[np.ndarray, "..."]) -> Float32[np.ndarray, "256"]:
    """256 numbers, ascending, with about the least sum of squared errors to the values, where a
    value counts the less the more there are near it: together as the cube root of their number.

    Few values are far out, but they are the largest Gaussians: codes for the many alone lost 10 dB
    in some views of the bear. Lloyd's iteration on a histogram; from quantiles of the cube root of
    the weights, which is how the best quantiser of many steps lies (Panter and Dite, 1951).
    """
    low, high = float(values.min()), float(values.max())
    if low == high:
        return np.full(CODES, low, np.float32)
    values = values.astype(np.float64)  # float32 has too few steps for the bins of a narrow range
    counts, edges = np.histogram(values, _BINS, (low, high))
    sums, _ = np.histogram(values, _BINS, (low, high), weights=values)
    centres = (edges[:-1] + edges[1:]) / 2
    near = counts.reshape(_COARSE, -1).sum(1)
    weights = np.repeat(np.maximum(near, 1) ** (-2 / 3), _BINS // _COARSE)
    share = np.cumsum(np.cbrt(np.cbrt(near)))
    ends = edges[_BINS // _COARSE :: _BINS // _COARSE]
    codes = np.interp((np.arange(CODES) + 0.5) / CODES * share[-1], share, ends)
    number = np.concatenate(([0], np.cumsum(counts * weights)))
    total = np.concatenate(([0], np.cumsum(sums * weights)))
    for _ in range(_ROUNDS):
        borders = np.searchsorted(centres, (codes[:-1] + codes[1:]) / 2)
        borders = np.concatenate(([0], borders, [_BINS]))
        own = np.diff(number[borders])
        means = np.diff(total[borders]) / np.where(own > 0, own, 1)
        codes = np.sort(np.where(own > 0, means, codes))
    return codes.astype(np.float32)


def nearest_codes(
    values: Float32[np.ndarray, "..."], codes: Float32[np.ndarray, "256"]
) -> Shaped[np.ndarray, "..."]:
    """The index of the nearest of ascending codes, one byte each."""
    return np.searchsorted((codes[:-1] + codes[1:]) / 2, values).astype(np.uint8)


def palette(
    rows: Float32[np.ndarray, "n d"], entries: int
) -> tuple[Float32[np.ndarray, "k d"], Int32[np.ndarray, " n"]]:
    """At most `entries` vectors that stand for the rows, and which one does for each row.

    Groups are cut in two at the mean of their column of largest variance, those of the largest
    squared error first, the worse half of them at a time (median cut, Heckbert 1982, by variance).
    O(n d) a round, about 30 rounds: k-means would compare every row with every entry.
    """
    order = np.arange(len(rows))
    groups = _Groups.of(rows, np.zeros(1, np.int64))
    while len(groups.starts) < entries and groups.errors.max() > 0:
        room = min(entries - len(groups.starts), max(1, len(groups.starts) // 2))
        chosen = np.sort(np.argsort(-groups.errors, kind="stable")[:room])
        groups = groups.cut(rows, order, chosen[groups.errors[chosen] > 0])
    sizes = np.diff(np.append(groups.starts, len(rows)))
    labels = np.empty(len(rows), np.int32)
    labels[order] = np.repeat(np.arange(len(sizes), dtype=np.int32), sizes)
    sums = np.add.reduceat(rows[order], groups.starts, axis=0, dtype=np.float64)
    return (sums / sizes[:, None]).astype(np.float32), labels


@dataclass(frozen=True, eq=False)
class _Groups:
    """Runs of rows in some order."""

    starts: Shaped[np.ndarray, " g"]
    """Ascending, from 0."""
    errors: Shaped[np.ndarray, " g"]
    """Sums of squared distances to the mean; 0 where no cut makes two groups."""
    columns: Shaped[np.ndarray, " g"]
    """Of the largest variance."""
    means: Shaped[np.ndarray, " g"]
    """In that column."""

    @staticmethod
    def of(rows: Float32[np.ndarray, "n d"], starts: Shaped[np.ndarray, " g"]) -> _Groups:
        """Of rows in the order of the groups."""
        sizes = np.diff(np.append(starts, len(rows)))[:, None]
        means = np.add.reduceat(rows, starts, axis=0, dtype=np.float64) / sizes
        squares = np.add.reduceat(np.square(rows, dtype=np.float32), starts, 0, np.float64)
        spread = (squares - sizes * means**2).clip(0)
        columns = spread.argmax(1)
        here = np.arange(len(starts)), columns
        return _Groups(starts, spread.sum(1), columns, means[here])

    def cut(
        self, rows: Float32[np.ndarray, "n d"], order: np.ndarray, chosen: np.ndarray
    ) -> _Groups:
        """All groups, the chosen ones in two; sorts their part of `order`."""
        first = self.starts[chosen]
        sizes = np.append(self.starts, len(rows))[chosen + 1] - first
        group = np.repeat(np.arange(len(chosen)), sizes)
        offsets = np.cumsum(sizes) - sizes
        places = np.arange(len(group)) + (first - offsets)[group]
        members = order[places]
        upper = rows[members, self.columns[chosen][group]] > self.means[chosen][group]
        members = members[np.argsort(2 * group + upper, kind="stable")]
        order[places] = members
        lower = sizes - np.bincount(group, upper, len(chosen)).astype(np.int64)
        whole = (lower == 0) | (lower == sizes)  # rows that differ by rounding only
        errors = self.errors.copy()
        errors[chosen[whole]] = 0
        keep = np.ones(len(self.starts), bool)
        keep[chosen[~whole]] = False
        halves = np.stack((offsets, offsets + lower), 1)
        inside = np.unique(halves[halves < len(members)].ravel())
        made = _Groups.of(rows[members], inside)
        fresh = np.repeat(~whole, sizes)[inside]
        starts = places[inside]
        parts = (
            np.concatenate((old[keep], new[fresh]))
            for old, new in (
                (self.starts, starts),
                (errors, made.errors),
                (self.columns, made.columns),
                (self.means, made.means),
            )
        )
        starts, errors, columns, means = parts
        sort = np.argsort(starts)
        return _Groups(starts[sort], errors[sort], columns[sort], means[sort])
