"""Changes done on the Gaussians themselves, where a route does them exactly: no view is edited."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool
from torch import Tensor

from gsedit.editing.routes.colors import parse_hex
from gsedit.editing.routes.paint import finish_of, painted
from gsedit.editing.routes.tone import toned
from gsedit.errors import UsageError
from gsedit.regions.region import Region, everything
from gsedit.scene.table import table_of
from gsedit.words.instruction import Change, Instruction
from rasterizer.scene import Gaussians

EXACT_ROUTES = ("tone", "paint")

FindRegion = Callable[[Gaussians], Region]
"""Finds the subject of a scene."""


@dataclass(frozen=True, eq=False)
class Routed:
    """A scene that routes changed."""

    scene: Gaussians
    inside: Bool[Tensor, " n"]
    """Gaussians that any of the changes could reach."""
    note: str
    """How the regions were found, for a person."""


def is_exact(instruction: Instruction) -> bool:
    """Whether every change of an understood instruction has a route that does it exactly."""
    changes = instruction.changes
    return instruction.known and bool(changes) and all(c.route in EXACT_ROUTES for c in changes)


def apply_change(scene: Gaussians, change: Change, region: Region) -> Gaussians:
    """The scene with one change on the Gaussians of a region; the others are the same bits.

    Raises UsageError for a region of no Gaussians, a route that is not exact, an unknown tone, an
    amount out of range, or a color that is none.
    """
    if not region.inside.any():
        raise UsageError(
            f"{change} would change no Gaussian: name what should change with --region, "
            "and look at it with gsedit render SCENE --region ..."
        )
    table, inside = table_of(scene), region.inside.cpu().numpy()
    match change.route:
        case "tone":
            after = toned(table, inside, change.name, change.amount, change.color)
        case "paint":
            after = painted(table, inside, parse_hex(change.color), finish_of(change.name))
        case _:
            raise UsageError(f"{change} has no exact route: edit with --editor small")
    return replace(scene, sh=torch.from_numpy(after.sh).to(scene.sh))


def apply_instruction(
    scene: Gaussians, instruction: Instruction, find_region: FindRegion
) -> Routed:
    """The scene with every change of the instruction, in order; the subject is searched once.

    Raises UsageError where a change has no exact route, and as `apply_change`, `find_region`.
    """
    if not is_exact(instruction):
        raise UsageError(f"{instruction} has no exact route: edit with --editor small")
    found: dict[str, Region] = {}
    after, inside = scene, torch.zeros(len(scene), dtype=torch.bool)
    for change in instruction.changes:
        if change.target not in found:
            found |= _regions(scene, change.target, find_region)
        region = found[change.target]
        after = apply_change(after, change, region)
        inside |= region.inside
    used = dict.fromkeys(change.target for change in instruction.changes)
    return Routed(after, inside, "; ".join(found[target].note for target in used))


def _regions(scene: Gaussians, target: str, find_region: FindRegion) -> Iterator[tuple[str, Region]]:
    """The region of a target, with that of its opposite where the subject was searched."""
    if target == "scene":
        return iter([("scene", everything(scene))])
    subject = find_region(scene)
    background = Region(~subject.inside, f"all but {subject.note}")
    return iter([("subject", subject), ("background", background)])
