"""Upward direction of a capture: by gravity where the photos have it, else by how people hold
cameras. `n` cameras, OpenCV axes (x right, y down, z forward), rotations in float64."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64

SURE = 3
"""Least cameras with gravity: fewer may be mistakes."""
AGREE = 10.0
"""Degrees within which most gravities must agree with their median."""
TRUST = 1e-3
"""Weight of the mean downward axis beside the cameras' right axes: it decides where those leave a
choice (all cameras look one way), and turns the result by a fifth of a degree at most else."""
CLEAR = 0.1
"""Gap between the two smallest eigenvalues of axes that lie across one direction and turned about
it: 0.5 for a full circle, 0.09 for 60 degrees, 0 where they leave a choice."""
ROUNDS = 20


def find_upright(
    world_to_cameras: Float64[np.ndarray, "n 4 4"], gravities: Float64[np.ndarray, "n 3"]
) -> tuple[Float64[np.ndarray, "3 3"], str]:
    """The rotation of the world after which y points down and the first of at least one camera
    looks along +z, seen from above, and what tells it: "gravity" or "the cameras".

    `gravities`: in camera axes, NaN where unknown.
    """
    axes = world_to_cameras[:, :3, :3]  # rows: right, down, forward in the world
    known = np.isfinite(gravities).all(1)
    down, source = None, "gravity"
    if known.sum() >= SURE:
        down = _agreed(np.einsum("nij,ni->nj", axes[known], gravities[known]))
    if down is None:
        down, source = down_of_cameras(axes), "the cameras"
    return _frame(down, axes), source


def down_of_cameras(axes: Float64[np.ndarray, "n 3 3"]) -> Float64[np.ndarray, "3"]:
    """The downward unit vector: the one that the cameras' right axes lie across, on the side of
    their downward axes. `axes`: rows right, down, forward in the world.

    Where instead the downward axes clearly turn about a direction, and the right axes do not, the
    cameras lay on their side (a video that lost its rotation): down is then the end of it that they
    look towards.
    """
    right, below, forward = (axes[:, i] for i in range(3))
    if _gap(below) > max(CLEAR, 2 * _gap(right)):
        down = _across(below, _unit(np.median(right, axis=0), otherwise=right[0]))
        return down if (forward @ down).mean() >= 0 else -down
    held = _unit(np.median(below, axis=0), otherwise=below[0])
    down = _across(right, held)
    return down if down @ held >= 0 else -down


def _gap(vectors: Float64[np.ndarray, "n 3"]) -> float:
    """Gap between the two smallest eigenvalues; see CLEAR."""
    smallest, second, _ = np.linalg.eigvalsh(vectors.T @ vectors / len(vectors))
    return float(second - smallest)


def _across(
    vectors: Float64[np.ndarray, "n 3"], likely: Float64[np.ndarray, "3"]
) -> Float64[np.ndarray, "3"]:
    """The direction that most of the vectors are perpendicular to, near `likely` where they leave a
    choice; of either sign."""
    prior = TRUST * (np.eye(3) - np.outer(likely, likely))
    weights = np.ones(len(vectors))
    found = likely
    for _ in range(ROUNDS):  # reweighted: a camera that was tilted counts by its tilt, not squared
        spread = np.einsum("n,ni,nj->ij", weights / weights.sum(), vectors, vectors)
        found = np.linalg.eigh(spread + prior)[1][:, 0]
        weights = 1 / np.maximum(np.abs(vectors @ found), 0.02)  # a degree of tilt is nothing
    return found


def _agreed(directions: Float64[np.ndarray, "k 3"]) -> Float64[np.ndarray, "3"] | None:
    """The median direction, if most lie near it."""
    down = _unit(np.median(directions, axis=0), otherwise=directions[0])
    for _ in range(ROUNDS):  # Weiszfeld's steps to the geometric median
        distance = np.maximum(np.linalg.norm(directions - down, axis=1), 1e-6)
        down = _unit((directions / distance[:, None]).sum(0), otherwise=down)
    near = directions @ down > np.cos(np.radians(AGREE))
    return down if near.mean() > 0.5 else None


def _frame(
    down: Float64[np.ndarray, "3"], axes: Float64[np.ndarray, "n 3 3"]
) -> Float64[np.ndarray, "3 3"]:
    """Right-handed axes with `down` as y, turned so that the first camera looks along z."""
    forward = axes[0, 2] - (axes[0, 2] @ down) * down
    if np.linalg.norm(forward) < 0.1:  # it looks straight down or up: its top leads
        forward = -axes[0, 1] - (-axes[0, 1] @ down) * down
    forward = _unit(forward)
    return np.stack((np.cross(down, forward), down, forward))


def _unit(
    vector: Float64[np.ndarray, "3"], otherwise: Float64[np.ndarray, "3"] | None = None
) -> Float64[np.ndarray, "3"]:
    length = np.linalg.norm(vector)
    if length < 1e-9 and otherwise is not None:
        return otherwise
    return vector / length
