"""Every defect that a Gaussian can have: its law, its threshold, why that threshold, what mends it;
and every defect of a scene file with the rows that have it, also of files that `load` refuses.

`n` Gaussians. No renderer can draw what has the first group, and `load` refuses it; `repair` mends
it. What has the second can be drawn, and is no part of what was captured; `find_defects` tells
which Gaussians have it, and `clean` removes it.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int64, Shaped, UInt8, UInt64

from gsedit.errors import UsageError
from gsedit.formats.streams import SceneSource
from gsedit.formats.validity import invalid_rows, without_turn, wrong_values
from gsedit.scene.neighbors import NEIGHBORS, covers, nearest
from gsedit.scene.quaternions import rotations
from gsedit.scene.table import SPLAT_FIELDS, SplatTable, concatenate_tables

Rows = Bool[np.ndarray, " n"]


@dataclass(frozen=True)
class Defect:
    """One thing that can be wrong with a Gaussian."""

    name: str
    law: str
    """Criterion in words; `{:g}` in it is the threshold."""
    mend: str
    """The command that mends it, and how."""
    threshold: float = 0.0
    """In the unit that the law names; of no meaning where the law has no number."""
    reason: str = ""
    """Reason for this threshold, in words."""

    @property
    def sentence(self) -> str:
        """The law with its threshold."""
        return self.law.format(self.threshold)


POSITION = Defect("position", "x, y or z is NaN or beyond 1e9", "clean --repair removes it")
ROTATION = Defect(
    "rotation",
    "the quaternion is zero, NaN or infinite",
    "clean --repair: identity where it is round (scales within a factor of 2), else removed",
    2.0,
    "how a ball is turned cannot be seen, how a disc is turned can",
)
SCALE = Defect(
    "scale",
    "a scale is NaN, zero, or above 1e9",
    "clean --repair: zero becomes the smallest float, others are removed",
)
OPACITY = Defect(
    "opacity",
    "the opacity's logit is NaN or infinite",
    "clean --repair: an infinite one becomes 15 or -15, NaN is removed",
)
COLOR = Defect("color", "f_dc is NaN or beyond 65,504", "clean --repair removes it")
HARMONICS = Defect("harmonics", "f_rest is NaN or beyond 65,504", "clean --repair sets it to 0")
INVALID = (POSITION, ROTATION, SCALE, OPACITY, COLOR, HARMONICS)

DUPLICATE = Defect("duplicate", "every number equals that of an earlier row", "clean removes it")
INVISIBLE = Defect(
    "invisible",
    "opacity below {:.4f}",
    "clean removes it",
    1 / 255,
    "one step of an 8-bit picture: renderers skip it, so that nothing changes without it",
)
GIANT = Defect(
    "giant",
    "a standard deviation above {:g} times the scene's radius, and the middle of the scene within "
    "2 standard deviations",
    "clean removes it",
    1.0,
    "fog before every camera; a sky is as large, and the scene is not inside its splats",
)
FLOATER = Defect(
    "floater",
    "its 8th neighbor is {:g} times as far as theirs, or farther than the scene's radius, and "
    "more than 2 standard deviations of its own away",
    "clean removes it",
    5.0,
    "on a surface the distance varies by less than 2; at 3, well-fitted scenes lose 0.1 % and "
    "more, at 5 at most 0.07 %",
)
NEEDLE = Defect(
    "needle",
    "longest to middle axis above {:g}, 2 standard deviations longer than 4 distances to the 8th "
    "neighbor and than 8 % of the scene's radius, and an end in the open",
    "clean removes it",
    5.0,
    "thin ones that follow an edge or a string are healthy: their ends touch others; a short one "
    "is no streak in a picture",
)
UNSEEN = Defect(
    "unseen",
    "it adds less than {:.4f} of a pixel to what each camera sees",
    "clean removes it, where the cameras are known",
    1 / 255,
    "one step of an 8-bit picture in a single pixel: no photo says anything of it, and a view from "
    "elsewhere shows it in front of what is right",
)
DEFECTS = (DUPLICATE, INVISIBLE, GIANT, FLOATER, NEEDLE, UNSEEN)
"""Defects that `clean` removes, in order of priority: a Gaussian has the first that fits."""


def invalid(table: SplatTable) -> dict[str, Rows]:
    """The rows with each defect of INVALID, by its name; a row may have several."""
    wrong = wrong_values(table)
    return {
        POSITION.name: wrong["means"].any(1),
        ROTATION.name: wrong["quats"].any(1) | without_turn(table),
        SCALE.name: wrong["log_scales"].any(1),
        OPACITY.name: wrong["logit_opacities"],
        COLOR.name: wrong["sh"][:, 0].any(1),
        HARMONICS.name: wrong["sh"][:, 1:].any((1, 2)),
    }


def invisible(table: SplatTable, least: float = INVISIBLE.threshold) -> Rows:
    """The rows of an opacity below `least`."""
    return table.opacities < least


def fingerprints(table: SplatTable) -> UInt64[np.ndarray, " n"]:
    """A number of 64 bits for each row: equal for equal rows, and for others at 1 in 10^19."""
    draw = np.random.default_rng(0)
    total = np.zeros(len(table), np.uint64)
    for name in SPLAT_FIELDS:
        numbers = np.asarray(getattr(table, name), np.float32)
        for column in numbers.reshape(len(table), int(np.prod(numbers.shape[1:]))).T:
            # mixed, so that sums of several columns rarely agree
            bits = column.copy().view(np.uint32).astype(np.uint64)
            factor, shift = draw.integers(1, 1 << 63, 2, dtype=np.uint64) | np.uint64(1)
            mixed = (bits + shift) * factor
            total += (mixed ^ (mixed >> np.uint64(29))) * factor
    return total


def repeated(keys: Shaped[np.ndarray, " n"]) -> Rows:
    """The rows whose key an earlier row has."""
    order = np.argsort(keys, kind="stable")
    again = np.zeros(len(keys), bool)
    again[order[1:]] = keys[order[1:]] == keys[order[:-1]]
    return again


KEPT, INVALID_ROW = 0, 1
"""Reasons that are no defect of DEFECTS; these have the numbers from 2 on, in its order."""
REASONS = ("kept", "invalid", *(defect.name for defect in DEFECTS))
"""The name of every number in an array of reasons."""
FEWEST = 64
"""Fewest Gaussians that tell what is usual: a smaller scene has no giants, floaters or needles."""
TINY = float(np.finfo(np.float32).tiny)
CORE_SHARE, OUTLIERS = 0.99, 20.0
"""The scene's radius holds this share of the centers; it is at most so many times the median
distance, which outliers do not move."""
END = 2.0
"""Standard deviations from its center at which a splat seems to end in a picture: 14 % of its
opacity are left."""
LONG, STREAK = 4.0, 0.08
"""A needle's 2 standard deviations are longer than so many distances to the 8th neighbor, and
than this share of the scene's radius."""
OPEN = 0.3
"""The end of a needle is in the open if others cover it with less than this share of the needle's
own opacity."""
ALIKE = 1.5
"""A needle holds the end of another one that is at most this many times shorter than itself: the
pieces of a string hold each other, a bundle of streaks of all lengths does not."""


@dataclass(frozen=True)
class Limits:
    """The thresholds of the laws in DEFECTS, in their units; None: the law is not asked."""

    invisible: float | None = INVISIBLE.threshold
    giant: float | None = GIANT.threshold
    floater: float | None = FLOATER.threshold
    needle: float | None = NEEDLE.threshold
    duplicates: bool = True

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if value is not None and not value >= 0:
                raise UsageError(f"the limit {field.name} is {value}: give a number above 0")


USUAL = Limits()


@dataclass(frozen=True, eq=False)
class Surroundings:
    """Properties of each Gaussian's neighbors that the criteria use."""

    distance: Float[np.ndarray, " n"]
    """To the 8th neighbor, world units."""
    usual: Float[np.ndarray, " n"]
    """The median of the same of its 8 neighbors."""
    radius: float
    """Radius of the scene about its middle, world units."""


def surroundings(table: SplatTable) -> Surroundings:
    """The neighbors of each Gaussian, and the size of the scene."""
    distance, rows = nearest(table.means, NEIGHBORS)
    usual = np.median(distance[rows], axis=1) if rows.shape[1] else distance
    return Surroundings(distance, usual, scene_radius(table.means))


def scene_radius(means: Float[np.ndarray, "n 3"]) -> float:
    """The distance from the median position that holds most centers; outliers do not move it."""
    offset = means.astype(np.float64) - np.median(means, axis=0)
    median, most = np.quantile(np.linalg.norm(offset, axis=1), (0.5, CORE_SHARE)).tolist()
    return min(most, OUTLIERS * median)


def find_defects(table: SplatTable, limits: Limits = USUAL) -> UInt8[np.ndarray, " n"]:
    """Why each Gaussian is no part of the scene: an index into REASONS, 0 for those that are.

    Of several reasons the first in the order of REASONS. Needs no torch.
    """
    reasons = np.full(len(table), KEPT, np.uint8)
    reasons[invalid_rows(table)] = INVALID_ROW
    if limits.duplicates:
        _mark(reasons, DUPLICATE.name, repeated(fingerprints(table)))
    if limits.invisible is not None:
        _mark(reasons, INVISIBLE.name, invisible(table, limits.invisible))
    left = np.flatnonzero(reasons == KEPT)
    if limits.giant is not None and len(left) > FEWEST:
        found = giants(table[left].replace(extra={}), limits.giant)
        _mark(reasons, GIANT.name, np.isin(np.arange(len(table)), left[found]))
    left = np.flatnonzero(reasons == KEPT)
    if len(left) <= FEWEST or limits.floater is limits.needle is None:
        return reasons
    some = table[left].replace(sh=table.sh[left, :1], extra={})
    about, found = surroundings(some), np.full(len(left), KEPT, np.uint8)
    if limits.floater is not None:
        _mark(found, FLOATER.name, floaters(some, about, limits.floater))
    if limits.needle is not None:
        _mark(found, NEEDLE.name, needles(some, about, limits.needle))
    reasons[left] = found
    return reasons


def giants(table: SplatTable, times: float) -> Rows:
    """The Gaussians larger than the scene in whose body its middle lies: not those of a sky."""
    large = np.flatnonzero(table.scales.max(1) > times * scene_radius(table.means))
    found = np.zeros(len(table), bool)
    if len(large):
        offset = np.median(table.means, axis=0) - table.means[large]
        local = np.einsum("mi,mij->mj", offset, rotations(table.quats[large]))
        apart = np.linalg.norm(local / np.maximum(table.scales[large], TINY), axis=1)
        found[large] = apart < END
    return found


def floaters(table: SplatTable, about: Surroundings, times: float) -> Rows:
    """The Gaussians that are far from all others, for what is usual there and for their size."""
    alone = (about.distance > times * about.usual) | (about.distance > about.radius)
    return alone & (about.distance > END * table.scales.max(1))


def needles(table: SplatTable, about: Surroundings, ratio: float) -> Rows:
    """The thin, long Gaussians of which one end touches nothing that stays."""
    scales = np.sort(table.scales, 1)
    length = END * scales[:, 2]
    thin = scales[:, 2] > ratio * scales[:, 1]
    thin &= (length > LONG * about.usual) & (length > STREAK * about.radius)
    rows, gone = np.flatnonzero(thin), np.zeros(len(table), bool)
    longest = table.log_scales[rows].argmax(1)[:, None, None]
    axes = np.take_along_axis(rotations(table.quats[rows]), longest, 2)[:, :, 0]
    ends = table.means[rows] + length[rows, None] * np.stack((axes, -axes))
    point, row, alpha = covers(table, ends.reshape(-1, 3))
    own = rows[point % max(len(rows), 1)]
    holds = ~thin[row] | (scales[row, 2] <= ALIKE * scales[own, 2])
    holds &= row != own
    point, row, alpha = point[holds], row[holds], alpha[holds]
    for _ in range(8):  # without the outermost of a bundle, the next end in the open
        stays = ~gone[row]
        covered = np.bincount(point[stays], alpha[stays], 2 * len(rows)).reshape(2, -1).min(0)
        gone[rows] |= covered < OPEN * table.opacities[rows]
    return gone


def _mark(reasons: UInt8[np.ndarray, " n"], name: str, rows: Rows) -> None:
    """Give the rows that have no reason yet this one."""
    reasons[rows & (reasons == KEPT)] = REASONS.index(name)


@dataclass(frozen=True, eq=False)
class Found:
    """The Gaussians with one defect."""

    defect: Defect
    rows: Int64[np.ndarray, " r"]
    """In the order of the file, from 0."""


@dataclass(frozen=True, eq=False)
class Report:
    """Defects that were found in a scene."""

    gaussians: int
    refused: int
    """Rows that make `load` refuse the file."""
    found: tuple[Found, ...]
    """The defects that some rows have: those of INVALID, then those of DEFECTS."""

    @property
    def defective(self) -> int:
        """Rows with any defect."""
        return len(np.unique(np.concatenate([f.rows for f in self.found]))) if self.found else 0


def check(source: SceneSource, limits: Limits = USUAL, *, quick: bool = False) -> Report:
    """Look for every defect that needs no cameras.

    `quick` leaves out those that depend on a Gaussian's neighbors; the file may then be larger
    than memory. Otherwise 64 bytes a Gaussian and the search tree are held.
    """
    parts: dict[str, list[np.ndarray]] = {defect.name: [] for defect in INVALID}
    parts |= {} if limits.invisible is None else {INVISIBLE.name: []}
    keys, flat = [], []
    count = refused = 0
    for block in source.blocks():
        bad = invalid_rows(block)
        refused += int(bad.sum())
        found = invalid(block) if bad.any() else {}
        if limits.invisible is not None:
            found[INVISIBLE.name] = invisible(block, limits.invisible) & ~bad
        for name, some in found.items():
            parts[name].append(count + np.flatnonzero(some))
        if limits.duplicates:
            keys.append(fingerprints(block))
        if not quick:
            flat.append(block.replace(sh=block.sh[:, :1].copy(), extra={}))
        count += len(block)
    none = np.zeros(0, np.int64)
    rows = {name: np.concatenate([none, *some]) for name, some in parts.items()}
    if keys:
        rows[DUPLICATE.name] = np.flatnonzero(repeated(np.concatenate(keys)))
    if flat:
        # what single rows show is known already, and does not count as a neighbor
        known = np.zeros(count, bool)
        known[np.concatenate([none, *rows.values()])] = True
        left = np.flatnonzero(~known)
        others = replace(limits, invisible=None, duplicates=False)
        why = find_defects(concatenate_tables(flat)[left], others)
        more = {name: left[why == number] for number, name in enumerate(REASONS)}
        rows = {**more, **rows}
    named = [(each, rows.get(each.name, none)) for each in (*INVALID, *DEFECTS)]
    return Report(count, refused, tuple(Found(*each) for each in named if len(each[1])))


ROWS_IN_A_LINE = 5
"""Rows that the line of a defect names; the record has all."""


def defect_record(report: Report) -> dict[str, Any]:
    """Return every defect with all its rows, for a program."""
    return {
        "gaussians": report.gaussians,
        "refused": report.refused,
        "defects": [
            {
                "name": each.defect.name,
                "law": each.defect.sentence,
                "reason": each.defect.reason,
                "mend": each.defect.mend,
                "count": len(each.rows),
                "rows": each.rows.tolist(),
            }
            for each in report.found
        ],
    }


def defect_table(path: Path, format: str, report: Report, quick: bool) -> str:
    """Return a line for each defect, then the commands that mend them."""
    lines = [f"{path}: {format}, {report.gaussians:,} Gaussians, {report.defective:,} with defects"]
    lines += [defect_line(each) for each in report.found]
    names = {each.defect.name for each in report.found}
    if report.refused:
        lines.append(
            f"{report.refused:,} rows are invalid and make other commands refuse the file: "
            f"gsedit clean {path} --repair -o REPAIRED.ply"
        )
    if any(not each.defect.mend.startswith("clean --repair") for each in report.found):
        first = "after that, " if report.refused else ""
        lines.append(f"{first}gsedit clean {path} -o CLEAN.ply removes the other defects")
    if not names:
        lines.append("no defect was found" + (" in single rows (--quick)" if quick else ""))
    return "\n".join(lines)


def defect_line(found: Found) -> str:
    """Return a defect with its count, its criterion and its first rows."""
    rows = ", ".join(map(str, found.rows[:ROWS_IN_A_LINE].tolist()))
    more = ", ..." if len(found.rows) > ROWS_IN_A_LINE else ""
    count = f"{len(found.rows):,}"
    return (
        f"  {found.defect.name:<11}{count:>9}  {found.defect.sentence}; {found.defect.mend} "
        f"(rows {rows}{more})"
    )
