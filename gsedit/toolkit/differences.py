"""How two scenes differ: their attributes, which Gaussians they share, and their pictures.

`a` is before, `b` after: any numbers of Gaussians and degrees of SH. `n` Gaussians, `m` pairs.
"""

from __future__ import annotations

import shlex
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from gsedit.errors import UsageError
from gsedit.measures import formulas as metrics
from gsedit.measures.decibels import psnr_from_rmse
from gsedit.toolkit.decimate import SIZE, VIEWS
from gsedit.toolkit.scene_summary import Quantiles, quantiles_of
from gsedit.views.around import find_viewpoints
from gsedit.views.viewpoints import Viewpoint
from rasterizer.numerics import DEFAULT, Numerics, sh_to_color
from rasterizer.render import render_picture
from rasterizer.scene import Gaussians

QUANTILES = (0.01, 0.5, 0.99)
SAMPLE = 400_000
"""Gaussians of each scene whose partners are looked for; of more, evenly spaced ones."""
FLIPPED = 0.1
"""Least distance between the quantiles of the centers, relative to their extent, for another frame
to be thought of; a frame explains it where it brings it below a fifth of that."""
RESCALED = 1.2
"""Ratio of extents from which the scale is said to differ."""

PROPERTIES: dict[str, Callable[[Gaussians], Float[Tensor, " n"]]] = {
    "x": lambda scene: scene.means[:, 0],
    "y": lambda scene: scene.means[:, 1],
    "z": lambda scene: scene.means[:, 2],
    "size": lambda scene: scene.log_scales.mean(-1).exp(),
    "longest": lambda scene: scene.log_scales.amax(-1).exp(),
    "opacity": lambda scene: scene.opacities,
    "red": lambda scene: _color(scene)[:, 0],
    "green": lambda scene: _color(scene)[:, 1],
    "blue": lambda scene: _color(scene)[:, 2],
    "sh_energy": lambda scene: scene.sh[:, 1:].square().sum((1, 2)),
}
"""Properties that are compared, by name. Positions and sizes (standard deviations: geometric mean,
and largest) in world units; opacity in [0, 1]; colors of SH degree 0; the sum of squares of the
coefficients above it."""


@dataclass(frozen=True)
class Attribute:
    """The distribution of a property in both scenes."""

    name: str
    before: Quantiles
    """Its values in the first scene, at QUANTILES."""
    after: Quantiles


@dataclass(frozen=True)
class Matches:
    """Gaussians of one scene that are in the other too: each is the other's nearest, and not
    farther than the larger one's largest standard deviation."""

    of_before: float
    """Share of a's Gaussians that have a partner in b."""
    of_after: float
    """Share of b's Gaussians that have a partner in a."""
    same_rows: bool
    """Whether partners have the same row: nothing was removed, added or reordered."""
    sampled: bool
    """Whether the shares are those of a sample."""
    moved: float | None
    """RMS distance between partners, world units; None where there are none, as below."""
    resized: float | None
    """RMS change of the logarithm of the size."""
    opacity: float | None
    """RMS change of the opacity."""
    color: float | None
    """RMS change of the color of SH degree 0, mean over channels."""


@dataclass(frozen=True)
class ViewDifference:
    """The two scenes from one camera; colors are clamped to [0, 1], over black."""

    name: str
    psnr: float
    """dB; 100 for equal pictures."""
    ssim: float
    largest: float
    """Largest difference of a color."""


@dataclass(frozen=True)
class SceneDifference:
    """Everything that was compared."""

    counts: tuple[int, int]
    sh_degrees: tuple[int, int]
    attributes: tuple[Attribute, ...]
    matches: Matches
    views: tuple[ViewDifference, ...]
    psnr: float
    """PSNR of the mean squared error over all views, dB; at most 100."""
    ssim: float
    """Mean over the views."""
    hints: tuple[str, ...]
    """Signs that the scenes are in different frames, a sentence each."""

    @property
    def worst(self) -> ViewDifference:
        """The view of the lowest PSNR."""
        return min(self.views, key=lambda view: view.psnr)


def diff(
    a: Gaussians,
    b: Gaussians,
    viewpoints: Sequence[Viewpoint] | None = None,
    *,
    numerics: tuple[Numerics, Numerics] = (DEFAULT, DEFAULT),
    progress: Callable[[int, int], None] | None = None,
) -> SceneDifference:
    """Compare two scenes, `a` before and `b` after, from the same cameras.

    Without viewpoints, views of `a` are found. `numerics` are those of `a` and of `b`. `progress`
    is told (views done, views). Raises UsageError for an empty scene, or no viewpoints.
    """
    if not len(a) or not len(b):
        raise UsageError("a scene without Gaussians cannot be compared")
    a, b = a.detach(), b.detach()
    if viewpoints is None:
        viewpoints = find_viewpoints(a, VIEWS, SIZE)
    views, errors = [], []
    for done, viewpoint in enumerate(viewpoints, 1):
        before, after = (
            render_picture(scene, viewpoint.camera, own) for scene, own in zip((a, b), numerics)
        )
        errors.append(metrics.squared_error(after, before))
        largest = float((after - before).abs().max())
        psnr = min(metrics.psnr(after, before), metrics.NEAREST)
        ssim = metrics.ssim(after, before)
        views.append(ViewDifference(viewpoint.name, psnr, ssim, largest))
        if progress is not None:
            progress(done, len(viewpoints))
    rmse = metrics.pooled_rmse(errors)
    if rmse is None:
        raise UsageError("no view to compare the scenes from: give at least one camera")
    return SceneDifference(
        (len(a), len(b)),
        (a.degree, b.degree),
        tuple(
            Attribute(name, *(_quantiles(of(scene)) for scene in (a, b)))
            for name, of in PROPERTIES.items()
        ),
        match(a, b),
        tuple(views),
        min(psnr_from_rmse(rmse), metrics.NEAREST),
        sum(view.ssim for view in views) / len(views),
        frame_hints(a, b),
    )  # fmt: skip


def match(a: Gaussians, b: Gaussians, most: int = SAMPLE) -> Matches:
    """Pair at most `most` Gaussians of two scenes, and measure how partners differ."""
    same_rows = len(a) == len(b) and bool(_near(a, b).all())
    sampled = max(len(a), len(b)) > most
    if same_rows:
        step = 1 + (len(a) - 1) // most
        return _matches(a[::step], b[::step], 1.0, 1.0, same_rows=True, sampled=False)
    from scipy.spatial import KDTree

    trees = [KDTree(scene.means.double().numpy()) for scene in (a, b)]
    rows_a, rows_b, of_before = _partners(a, b, *trees, most=most)
    _, _, of_after = _partners(b, a, *reversed(trees), most=most)
    return _matches(a[rows_a], b[rows_b], of_before, of_after, same_rows=False, sampled=sampled)


def frame_hints(a: Gaussians, b: Gaussians) -> tuple[str, ...]:
    """Sentences on scenes that seem to be in different frames, from the quantiles of the centers;
    none for scenes in one frame."""
    boxes = [
        torch.tensor([_quantiles(axis) for axis in scene.means.T], dtype=torch.float64)
        for scene in (a, b)
    ]
    extents = [(box[:, 2] - box[:, 0]).norm().clamp_min(1e-12) for box in boxes]
    distance = float((boxes[0] - boxes[1]).norm() / extents[0])
    if not isfinite(distance) or distance < FLIPPED:
        return ()
    hints = []
    best, signs = min(
        (float((boxes[0] - other).norm() / extents[0]), signs)
        for signs in product((1, -1), repeat=3)
        for other in [torch.stack([a if s > 0 else -a.flip(0) for a, s in zip(boxes[1], signs)])]
    )
    if best < FLIPPED / 5:
        axes = [name for name, sign in zip("xyz", signs) if sign < 0]
        hint = f"the second scene has {' and '.join(axes)} negated: it is in another frame"
        if len(axes) % 2:  # which no turn brings back
            mirrors = " ".join(f"--mirror {axis}" for axis in axes)
            hint = f"{hint}, mirrored; gsedit transform {mirrors} mirrors it back"
        hints.append(hint)
    ratio = float(extents[1] / extents[0])
    if not 1 / RESCALED < ratio < RESCALED:
        hints.append(f"the second scene is {ratio:.3g} times as large")
    low, high = (
        torch.maximum(boxes[0][:, 0], boxes[1][:, 0]),
        torch.minimum(boxes[0][:, 2], boxes[1][:, 2]),
    )
    if bool((low > high).any()) and best >= FLIPPED / 5:
        hints.append("the scenes lie in different places: they are in different frames")
    return tuple(hints)


def _quantiles(values: Float[Tensor, " n"]) -> Quantiles:
    """The values at QUANTILES; 0 of none."""
    return quantiles_of(values.detach().numpy().copy(), QUANTILES)


def _color(scene: Gaussians) -> Float[Tensor, "n 3"]:
    return sh_to_color(scene.sh[:, 0])


def _near(a: Gaussians, b: Gaussians) -> Tensor:
    """Tell which rows of two scenes of equal length lie within the larger one's reach."""
    reach = torch.maximum(a.log_scales.amax(-1), b.log_scales.amax(-1)).exp()
    return (a.means - b.means).norm(dim=-1) <= reach


def _partners(
    a: Gaussians, b: Gaussians, tree_a: Any, tree_b: Any, most: int
) -> tuple[Int[Tensor, " m"], Int[Tensor, " m"], float]:
    """Rows of a sample of `a` that have a partner in `b`, the partners' rows, and the share of the
    sample that has one."""
    step = 1 + (len(a) - 1) // most
    rows = np.arange(0, len(a), step)
    _, there = tree_b.query(a.means[::step].double().numpy())
    _, back = tree_a.query(b.means[torch.from_numpy(there)].double().numpy())
    mutual = back == rows
    rows_a, rows_b = torch.from_numpy(rows[mutual]), torch.from_numpy(there[mutual])
    near = _near(a[rows_a], b[rows_b])
    return rows_a[near], rows_b[near], float(near.sum()) / len(rows)


def _matches(
    a: Gaussians, b: Gaussians, of_before: float, of_after: float, *, same_rows: bool, sampled: bool
) -> Matches:
    """Summarize the differences of partners, row by row."""
    changes: list[float | None] = [None] * 4
    if len(a):
        differences = (
            (a.means - b.means).norm(dim=-1),
            (a.log_scales - b.log_scales).mean(-1),
            a.opacities - b.opacities,
            _color(a) - _color(b),
        )
        changes = [float(each.double().square().mean().sqrt()) for each in differences]
    return Matches(of_before, of_after, same_rows, sampled, *changes)


def difference_table(result: SceneDifference, paths: tuple[Path, Path]) -> str:
    """Return the comparison of two scenes, named by their files, as aligned tables."""
    counts, degrees = result.counts, result.sh_degrees
    change = f"{100 * (counts[1] - counts[0]) / counts[0]:+.1f} %"
    quantiles = "".join(f"{q:<10.0%}" for q in QUANTILES)
    lines = [
        row("", "before", "after", "change"),
        row("file", shortened(paths[0]), shortened(paths[1])),
        row("Gaussians", f"{counts[0]:,}", f"{counts[1]:,}", change),
        row("SH degree", f"{degrees[0]}", f"{degrees[1]}", f"{degrees[1] - degrees[0]:+}"),
        row("", quantiles, quantiles, "of 50%"),
    ]
    for each in result.attributes:
        if each.name == "sh_energy" and degrees == (0, 0):
            continue
        before, after = (
            "".join(f"{value:<10.3g}" for value in values) for values in (each.before, each.after)
        )
        lines.append(row(each.name, before, after, f"{each.after[1] - each.before[1]:+.2g}"))
    lines += ["", matches_text(result.matches), "", views_text(result)]
    lines += [f"-> {hint}" for hint in result.hints]
    if result.hints and not any("--mirror" in hint for hint in result.hints):
        command = ["gsedit", "align", f"{paths[1]}", "--to", f"{paths[0]}", "-o", "ALIGNED.ply"]
        lines.append(f"-> to compare them in one frame: {shlex.join(command)}")
    return "\n".join(lines)


def row(name: str, before: str, after: str, change: str = "") -> str:
    """Return a line of the table of attributes."""
    return f"{name:<11}{before:<31}{after:<31}{change}".rstrip()


def shortened(path: Path) -> str:
    """Return a file's name in 30 characters, with its folder if there is room."""
    text = str(path)
    return text if len(text) <= 30 else path.name[:30]


def matches_text(matches: Matches) -> str:
    """Return which Gaussians both scenes share, in words."""
    sample = " (of a sample)" if matches.sampled else ""
    if matches.same_rows:
        text = "the same Gaussians, row by row"
    else:
        text = (
            f"{matches.of_before:.1%} of the first scene's Gaussians are in the second, "
            f"{matches.of_after:.1%} of the second's in the first{sample}"
        )
    if matches.moved is None or max(matches.of_before, matches.of_after) < 0.01:
        return text
    return (
        f"{text}\nthese differ (RMS) in place by {matches.moved:.3g}, in the logarithm of size by "
        f"{matches.resized:.3g}, in opacity by {matches.opacity:.3g}, in color by "
        f"{matches.color:.3g}"
    )


def views_text(result: SceneDifference) -> str:
    """Return a line for each view, and one for all of them."""
    lines = [f"{'view':<24}{'PSNR, dB':>10}{'SSIM':>9}{'largest difference':>20}"]
    for view in result.views:
        mark = "  worst" if view is result.worst and len(result.views) > 1 else ""
        numbers = f"{view.psnr:>10.2f}{view.ssim:>9.4f}{view.largest:>20.3f}"
        lines.append(f"{view.name[:23]:<24}{numbers}{mark}")
    return "\n".join([*lines, f"{'all':<24}{result.psnr:>10.2f}{result.ssim:>9.4f}"])
