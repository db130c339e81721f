"""A picture with a hole, completed from its own texture: copied in large parts, blended in light.

The hole's pixels are copied from known ones by a few shifts: those by which the texture repeats
itself (statistics of patch offsets, He and Sun 2012) and those that reach into the hole. Labels say
which shift each pixel has, with seams where they show least (alpha expansion, Boykov, Veksler and
Zabih 2001); then light is evened by gradients (Poisson's equation).
`h w` pixels, `c` channels; a hole of `p`; `e` pairs of neighbors; `k` shifts, each (rows, columns)
from a pixel to where it is copied from.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int64
from scipy.ndimage import binary_erosion, gaussian_filter, maximum_filter
from scipy.sparse import coo_matrix, csr_matrix, diags
from scipy.sparse.csgraph import breadth_first_order, maximum_flow
from scipy.sparse.linalg import splu
from scipy.spatial import KDTree

from gsedit.change.objects.removal.cells import mean_around, widened

ANCHOR = 1e-6
"""Weight of what a pixel has, against one difference: decides where nothing around is known."""


def pixel_pairs(
    hole: Bool[np.ndarray, "h w"], known: Bool[np.ndarray, "h w"]
) -> Int64[np.ndarray, "e 2"]:
    """Flat indices of neighbors, at least one of them in the hole and the other there or known."""
    flat = np.arange(hole.size).reshape(hole.shape)
    usable = hole | known
    found = []
    for a, b in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:])):
        at = usable[a] & usable[b] & (hole[a] | hole[b])
        found.append(np.stack((flat[a][at], flat[b][at]), 1))
    return np.concatenate(found)


def solve_membrane(
    values: Float[np.ndarray, "h w c"],
    hole: Bool[np.ndarray, "h w"],
    known: Bool[np.ndarray, "h w"],
    steps: tuple[Int64[np.ndarray, "e 2"], Float[np.ndarray, "e c"]] | None = None,
) -> Float[np.ndarray, "h w c"]:
    """Values with a hole filled so that neighbors differ by `steps` (second less first of a pair).

    Without steps they differ as little as they can. The rest keeps its values; a hole that nothing
    known touches keeps those that it has.
    """
    if not hole.any():
        return values
    if steps is None:
        pairs = pixel_pairs(hole, known)
        steps = pairs, np.zeros((len(pairs), values.shape[-1]))
    pairs, differences = steps
    count = int(hole.sum())
    number = np.full(hole.size, -1)
    number[hole.reshape(-1)] = np.arange(count)
    flat = values.reshape(hole.size, -1).astype(np.float64)
    rows, entries, right = [], [], []
    for sign, near in ((1, 1), (-1, 0)):  # which of the pair is given by its neighbor
        inside = number[pairs[:, near]]
        rows.append(inside)
        entries.append(number[pairs[:, 1 - near]])
        given = np.where((entries[-1] < 0)[:, None], flat[pairs[:, 1 - near]], 0)
        right.append(sign * differences + given)
    row, column, target = (np.concatenate(each) for each in (rows, entries, right))
    target, column, row = target[row >= 0], column[row >= 0], row[row >= 0]
    degree = np.bincount(row, minlength=count) + ANCHOR
    both = column >= 0
    links = csr_matrix((np.ones(both.sum()), (row[both], column[both])), (count, count))
    b = ANCHOR * flat[hole.reshape(-1)]
    np.add.at(b, row, target)
    solved = splu((diags(degree) - links).tocsc()).solve(b)
    out = flat.copy()
    out[hole.reshape(-1)] = solved
    return out.reshape(values.shape)


PATCH = 5
"""Side of a patch, pixels."""
COMPONENTS = 12
"""Principal components by which patches are compared."""
MOST_PATCHES = 6000
"""Patches that are compared; more change no statistics."""
NEIGHBORS = 12
"""Patches that are asked for, to find one that is not the same place."""
REPEATED, REACHING = 24, 24
"""Shifts taken from what repeats, and from what covers most of the hole."""


def find_shifts(
    picture: Float[np.ndarray, "h w 3"],
    known: Bool[np.ndarray, "h w"],
    hole: Bool[np.ndarray, "h w"],
) -> Int64[np.ndarray, "k 2"]:
    """Shifts from pixels of a hole to known ones; none is zero, some reach most of the hole."""
    covers = _coverage(known, hole)
    shifts = [*_peaks(_repeats(picture, known) * (covers > 0), REPEATED)]
    shifts += _reaching(known, hole, covers)
    return np.unique(np.array(shifts, np.int64).reshape(-1, 2), axis=0)


def _coverage(
    known: Bool[np.ndarray, "h w"], hole: Bool[np.ndarray, "h w"]
) -> Float[np.ndarray, "a b"]:
    """Pixels of the hole that each shift, of -h..h by -w..w, takes to known ones."""
    shape = (2 * hole.shape[0], 2 * hole.shape[1])
    there, here = (np.fft.rfft2(mask.astype(np.float64), shape) for mask in (known, hole))
    return np.fft.fftshift(np.round(np.fft.irfft2(there * here.conj(), shape)))


def _repeats(
    picture: Float[np.ndarray, "h w 3"], known: Bool[np.ndarray, "h w"]
) -> Float[np.ndarray, "a b"]:
    """How many patches find their like by each shift, smoothed; as large as `_coverage`."""
    h, w = known.shape
    votes = np.zeros((2 * h, 2 * w))
    half = PATCH // 2
    inner = binary_erosion(known, np.ones((PATCH, PATCH)))
    places = np.argwhere(inner)
    if len(places) <= NEIGHBORS:
        return votes
    places = places[:: 1 + len(places) // MOST_PATCHES]
    windows = np.lib.stride_tricks.sliding_window_view(picture, (PATCH, PATCH), (0, 1))
    patches = windows[places[:, 0] - half, places[:, 1] - half].reshape(len(places), -1)
    patches = patches - patches.mean(0)
    axes = np.linalg.eigh(patches.T @ patches)[1][:, -COMPONENTS:]
    reduced = patches @ axes
    _, near = KDTree(reduced).query(reduced, k=NEIGHBORS, workers=-1)
    offsets = places[near] - places[:, None]
    far = np.abs(offsets).max(-1) > max(h, w) / 15
    first = far.argmax(1)
    found = offsets[np.arange(len(places)), first][far.any(1)]
    np.add.at(votes, (found[:, 0] + h, found[:, 1] + w), 1)
    return gaussian_filter(votes, 1.0)


def _peaks(votes: Float[np.ndarray, "a b"], count: int) -> Int64[np.ndarray, "k 2"]:
    """The shifts of the highest local maxima of a map of votes."""
    top = (votes == maximum_filter(votes, 5)) & (votes > 0)
    rows = np.argwhere(top)
    best = rows[np.argsort(-votes[top], kind="stable")[:count]]
    return best - np.array(votes.shape) // 2


def _reaching(
    known: Bool[np.ndarray, "h w"], hole: Bool[np.ndarray, "h w"], covers: np.ndarray
) -> list[Int64[np.ndarray, "2"]]:
    """Shifts that take all of the hole to known pixels, one after the other the widest-reaching."""
    left, shifts = hole.copy(), []
    while left.any() and len(shifts) < REACHING:
        covers = covers if not shifts else _coverage(known, left)
        if covers.max() < 1:
            break
        at = np.array(np.unravel_index(covers.argmax(), covers.shape)) - np.array(hole.shape)
        shifts.append(at)
        left &= ~_at(_places(hole.shape) + at, known)[1]
    return [*shifts, *_peaks(_coverage(known, hole), REACHING)]


SWEEPS = 3
"""Times that every shift is offered to all pixels."""
UNIT = 1000
"""Steps of a cost of 1: cuts are found in integers."""
NEVER = 50.0
"""Cost of a shift that leads to nothing known: more than any way around it."""


def best_labels(
    single: Float[np.ndarray, "k p"],
    values: Float[np.ndarray, "k p 3"],
    pairs: Int64[np.ndarray, "e 2"],
) -> Int64[np.ndarray, " p"]:
    """The label of each pixel with the least sum of its cost and of the seams to its neighbors.

    `single` is the cost of each label, `values` the color that it gives a pixel. Neighbors of two
    labels cost what these give differently at both pixels.
    """
    labels = single.argmin(0)
    energy = _energy(labels, single, values, pairs)
    for _ in range(SWEEPS):
        before = energy
        for label in range(len(single)):
            moved = _expanded(labels, label, single, values, pairs)
            after = _energy(moved, single, values, pairs)
            if after < energy:
                labels, energy = moved, after
        if energy >= before:
            break
    return labels


def _seams(
    a: Int64[np.ndarray, " e"],
    b: Int64[np.ndarray, " e"],
    values: Float[np.ndarray, "k p 3"],
    pairs: Int64[np.ndarray, "e 2"],
) -> Float[np.ndarray, " e"]:
    """Cost of label `a` at the first of each pair and `b` at the second."""
    first, second = pairs.T
    at = np.linalg.norm(values[a, first] - values[b, first], axis=-1)
    return at + np.linalg.norm(values[a, second] - values[b, second], axis=-1)


def _energy(
    labels: Int64[np.ndarray, " p"],
    single: Float[np.ndarray, "k p"],
    values: Float[np.ndarray, "k p 3"],
    pairs: Int64[np.ndarray, "e 2"],
) -> float:
    seams = _seams(labels[pairs[:, 0]], labels[pairs[:, 1]], values, pairs)
    return float(single[labels, np.arange(len(labels))].sum() + seams.sum())


def _expanded(
    labels: Int64[np.ndarray, " p"],
    label: int,
    single: Float[np.ndarray, "k p"],
    values: Float[np.ndarray, "k p 3"],
    pairs: Int64[np.ndarray, "e 2"],
) -> Int64[np.ndarray, " p"]:
    """The best labels of those that keep theirs or take `label`: a minimal cut."""
    count = len(labels)
    first, second = pairs.T
    new = np.full(len(pairs), label)
    keep = _seams(labels[first], labels[second], values, pairs)
    one = _seams(labels[first], new, values, pairs)  # the second takes the label
    other = _seams(new, labels[second], values, pairs)
    stay, take = single[labels, np.arange(count)].copy(), single[label].copy()
    # E(x, y) with x, y = 1 for taking: keep + (other - keep) x + (0 - other) y + rest (1 - x) y
    np.add.at(take, first, other - keep)
    np.add.at(take, second, -other)
    rest = np.maximum(one + other - keep, 0)
    low = np.minimum(stay, take)
    to_take, to_stay = take - low, stay - low
    source, sink = count, count + 1
    nodes = np.arange(count)
    rows = np.concatenate((np.full(count, source), nodes, first))
    columns = np.concatenate((nodes, np.full(count, sink), second))
    # source side stays (x = 0): cut source->p is paid by taking; p->sink by staying
    weights = np.concatenate((to_take, to_stay, rest))
    whole = np.round(weights * UNIT).astype(np.int32)
    graph = coo_matrix((whole, (rows, columns)), (count + 2, count + 2)).tocsr()
    flow = maximum_flow(graph, source, sink).flow
    residual = graph - flow
    residual.data = np.maximum(residual.data, 0)
    residual.eliminate_zeros()
    reached = breadth_first_order(residual, source, return_predecessors=False)
    stays = np.zeros(count + 2, bool)
    stays[reached] = True
    return np.where(stays[:count], labels, label)


MOST_LABELED = 2500
"""Pixels of a hole whose shifts are searched; a larger hole is searched in a smaller picture."""
ODD, RARE = 4.5, 0.04
"""Distance from the middle color, of the median distance, from which pixels are not copied, where
they are fewer than this share: more are the texture itself, as mortar."""
LEAST_KNOWN = 0.15
"""Least known pixels, of the hole's, from which its texture is made up."""


@dataclass(frozen=True, eq=False)
class Completed:
    """A picture without its hole."""

    picture: Float[np.ndarray, "h w 3"]
    source: Int64[np.ndarray, "h w 2"]
    """Row and column that each pixel is copied from; its own where it is known."""
    textured: bool
    """Whether texture was copied; else the hole is smooth."""


def complete(
    picture: Float[np.ndarray, "h w 3"],
    known: Bool[np.ndarray, "h w"],
    hole: Bool[np.ndarray, "h w"],
) -> Completed:
    """Fill a hole from what is known; pixels that are neither are read and written nowhere."""
    own = _places(hole.shape)
    if not hole.any() or not known.any():
        return Completed(picture, own, False)
    smooth = solve_membrane(picture, hole, known)
    if known.sum() < LEAST_KNOWN * hole.sum():
        return Completed(smooth, own, False)
    factor = int(np.ceil(np.sqrt(hole.sum() / MOST_LABELED)))
    small, sources, gap = _reduced(picture, known, hole, factor)
    sources &= ~_odd(small, sources)
    shifts = find_shifts(small, sources, gap)
    if not len(shifts):
        return Completed(smooth, own, False)
    field = np.zeros((*gap.shape, 2), np.int64)
    field[gap] = shifts[_labels(small, sources, gap, shifts)]
    source = own.copy()
    fine = np.kron(field, np.ones((factor, factor, 1), np.int64))[: len(hole), : hole.shape[1]]
    source[hole] += factor * fine[hole]
    return Completed(_blended(picture, known, hole, source, smooth), source, True)


def _places(shape: tuple[int, ...]) -> Int64[np.ndarray, "h w 2"]:
    """Row and column of every pixel."""
    rows, columns = np.indices(shape[:2])
    return np.stack((rows, columns), -1)


def _odd(
    picture: Float[np.ndarray, "h w 3"], known: Bool[np.ndarray, "h w"]
) -> Bool[np.ndarray, "h w"]:
    """Pixels unlike most others: a leaf or a stain, which would show as a copy."""
    if not known.any():
        return known
    away = np.linalg.norm(picture - np.median(picture[known], 0), axis=-1)
    odd = known & (away > ODD * np.median(away[known]))
    return widened(odd, 1) if odd.sum() < RARE * known.sum() else np.zeros_like(odd)


def _reduced(
    picture: Float[np.ndarray, "h w 3"],
    known: Bool[np.ndarray, "h w"],
    hole: Bool[np.ndarray, "h w"],
    factor: int,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Picture, known and hole of blocks; a block is known if all of it is, and a hole if any."""
    rows, columns = (-(-side // factor) for side in hole.shape)
    pad = [(0, rows * factor - hole.shape[0]), (0, columns * factor - hole.shape[1])]

    def blocks(values: np.ndarray) -> np.ndarray:
        """Values by block, a block's own in the last axis but the channels'."""
        padded = np.pad(values, pad + [(0, 0)] * (values.ndim - 2))
        split = padded.reshape(rows, factor, columns, factor, *values.shape[2:])
        return np.moveaxis(split, 2, 1).reshape(rows, columns, factor**2, *values.shape[2:])

    counts = blocks(known).sum(2)
    mean = blocks(np.where(known[..., None], picture, 0)).sum(2) / np.maximum(counts, 1)[..., None]
    gap = np.asarray(blocks(hole).any(2))
    return mean, (counts >= factor**2) & ~gap, gap


def _at(
    places: Int64[np.ndarray, "*b 2"], mask: Bool[np.ndarray, "h w"]
) -> tuple[Int64[np.ndarray, "*b"], Bool[np.ndarray, "*b"]]:
    """Flat indices of places, and whether each is in the picture and flagged."""
    h, w = mask.shape
    within = ((places >= 0) & (places < (h, w))).all(-1)
    flat = np.where(within, places[..., 0] * w + places[..., 1], 0)
    return flat, within & mask.reshape(-1)[flat]


def _labels(
    picture: Float[np.ndarray, "h w 3"],
    known: Bool[np.ndarray, "h w"],
    hole: Bool[np.ndarray, "h w"],
    shifts: Int64[np.ndarray, "k 2"],
) -> Int64[np.ndarray, " p"]:
    """The shift of each pixel of the hole: an index."""
    colors, places = picture.reshape(-1, 3), _places(hole.shape).reshape(-1, 2)
    inside = np.flatnonzero(hole)
    at, usable = _at(places[inside] + shifts[:, None], known)
    values = np.where(usable[..., None], colors[at], 0.5)
    single = np.where(usable, 0.0, NEVER)
    number = np.full(hole.size, -1)
    number[inside] = np.arange(len(inside))
    pairs = pixel_pairs(hole, known)
    for near in (0, 1):  # what a shift shows of a known neighbor should be that neighbor
        own, other = number[pairs[:, near]], pairs[:, 1 - near]
        rim = (own >= 0) & (number[other] < 0)
        own, other = own[rim], other[rim]
        seen, there = _at(places[other] + shifts[:, None], known)
        cost = np.where(there, 2 * np.linalg.norm(colors[seen] - colors[other], axis=-1), 2.0)
        np.add.at(single.T, own, cost.T)
    ends = number[pairs]
    return best_labels(single, values, ends[(ends >= 0).all(1)])


EVENED, ROUNDS = 0.1, 3
"""Standard deviation over which light is averaged along a hole's border, of the hole's size, and
how often, with less weight each time for what is unlike."""


def _blended(
    picture: Float[np.ndarray, "h w 3"],
    known: Bool[np.ndarray, "h w"],
    hole: Bool[np.ndarray, "h w"],
    source: Int64[np.ndarray, "h w 2"],
    smooth: Float[np.ndarray, "h w 3"],
) -> Float[np.ndarray, "h w 3"]:
    """Copies by gradients: their steps inside, at the border what the light makes of them there. A
    leaf that lies on the border has no part in that: its color would run into the hole."""
    places = _places(hole.shape)
    shift = (source - places).reshape(-1, 2)
    places, colors = places.reshape(-1, 2), picture.reshape(-1, 3)
    pairs = pixel_pairs(hole, known)
    total, votes = np.zeros((len(pairs), 3)), np.zeros((len(pairs), 1))
    rim, copies = np.zeros(hole.size, bool), colors.copy()
    for end in (0, 1):  # the shift of either pixel says how the two differ
        moved = places[pairs] + shift[pairs[:, end]][:, None]
        at, there = _at(moved, known)
        fits = hole.reshape(-1)[pairs[:, end]] & there.all(1)
        step = colors[at[:, 1]] - colors[at[:, 0]]
        total += np.where(fits[:, None], step, 0)
        votes += fits[:, None]
        rim[pairs[fits, 1 - end]] = True
        copies[pairs[fits, 1 - end]] = colors[at[fits, 1 - end]]
    rim, copies = rim.reshape(hole.shape) & known, copies.reshape(picture.shape)
    light = _even(np.where(rim[..., None], picture - copies, 0.0), rim)
    given = np.where(rim[..., None], copies + light, smooth)
    blended = solve_membrane(given, hole, known, (pairs, total / np.maximum(votes, 1)))
    low, high = picture[known].min(0), picture[known].max(0)
    return np.where(hole[..., None], np.clip(blended, low, high), picture)


def _even(
    values: Float[np.ndarray, "h w 3"], rim: Bool[np.ndarray, "h w"]
) -> Float[np.ndarray, "h w 3"]:
    """Values along a rim, even, without those that are unlike what is around them."""
    weights = rim.astype(np.float64)
    even = values
    for _ in range(ROUNDS * rim.any()):
        even = mean_around(values, weights, max(2.0, EVENED * rim.sum() / np.pi))
        away = np.linalg.norm(values - even, axis=-1)
        weights = rim / (1 + np.square(away / max(np.median(away[rim]), 1e-6)))
    return even
