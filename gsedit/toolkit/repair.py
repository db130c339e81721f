"""Repair rows that no renderer can draw, by the smallest change that makes them valid."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from gsedit.formats.quantised import LOGIT_MAX
from gsedit.formats.streams import Blocks, SceneHeader
from gsedit.formats.validity import invalid_rows, wrong_values
from gsedit.scene.table import SplatTable
from gsedit.toolkit.defects import ROTATION, invalid
from gsedit.toolkit.operation import Operation, Say, Scene, apply, silent

FLAT = float(np.log(np.finfo(np.float32).tiny))
"""The log scale of what has no thickness: of the smallest normal float."""


@dataclass(frozen=True)
class Repair(Operation):
    """Mend invalid rows, and remove those that cannot be mended; valid rows stay as they are."""

    removes: ClassVar[bool] = True

    def blocks(self, blocks: Blocks, header: SceneHeader, say: Say) -> Iterator[SplatTable]:
        counts: Counter[str] = Counter()
        for block in blocks:
            yield repaired(block, counts)
        for what, count in counts.items():
            say(f"{count:,} {what}")
        if not counts:
            say("nothing to repair")


def repaired(table: SplatTable, counts: Counter[str]) -> SplatTable:
    """The rows that are valid or could be mended; what was done is counted, by a phrase."""
    if not invalid_rows(table).any():
        return table
    changes = {}
    found = invalid(table)
    infinite = np.isinf(table.logit_opacities)
    if infinite.any():
        changes["logit_opacities"] = np.where(
            infinite,
            np.copysign(np.float32(LOGIT_MAX), table.logit_opacities),
            table.logit_opacities,
        )
    flat = np.isneginf(table.log_scales)
    if flat.any():
        changes["log_scales"] = np.where(flat, np.float32(FLAT), table.log_scales)
    with np.errstate(invalid="ignore"):
        spread = np.ptp(changes.get("log_scales", table.log_scales), axis=1)
    unturned = found[ROTATION.name] & (spread <= np.log(ROTATION.threshold))
    if unturned.any():
        identity = np.array([1, 0, 0, 0], np.float32)
        changes["quats"] = np.where(unturned[:, None], identity, table.quats)
    blank = wrong_values(table)["sh"]
    blank[:, 0] = False
    if blank.any():
        changes["sh"] = np.where(blank, np.float32(0), table.sh)
    mended = table.replace(**changes)
    left = invalid_rows(mended)
    for what, rows in (
        ("infinite opacities became 15 or -15 (logits)", infinite),
        ("scales of zero became the smallest float", flat.any(1)),
        ("lost rotations of round Gaussians became the identity", unturned),
        ("Gaussians lost view-dependent colors that were NaN or infinite", blank.any((1, 2))),
    ):
        counts[what] += int((rows & ~left).sum())
    for name, rows in invalid(mended).items():
        counts[f"Gaussians removed: {name} cannot be mended"] += int((rows & left).sum())
        left &= ~rows  # one reason a row
    counts += Counter()  # without those of 0
    return mended[~invalid_rows(mended)]


def repair(scene: Scene, say: Say = silent) -> Scene:
    """The scene with all rows valid: see `Repair`. `say` receives what was done, with counts."""
    return apply(scene, Repair(), say=say)
