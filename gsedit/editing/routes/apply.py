"""Changes done on the Gaussians themselves, where a route does them exactly: no view is edited."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from operator import attrgetter

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from gsedit.cameras.place import light_note, place_of
from gsedit.datasets.dataset import evenly_spaced
from gsedit.editing.routes.named import FindNamed, FindRegion, regions_of
from gsedit.editing.routes.objects import apply_objects, carry_masks, group_placements, key_of
from gsedit.editing.routes.tone import toned
from gsedit.errors import Said, UsageError
from gsedit.formats.registry import open_scene
from gsedit.light.named import setup_of
from gsedit.light.relight import relit
from gsedit.materials.apply import Dressed, in_material
from gsedit.materials.named import material_of, paint_of
from gsedit.objects.outcome import NEW, Outcome, same
from gsedit.scene.cache import cached_per_scene
from gsedit.scene.table import table_of
from gsedit.scenery.named import SCENERIES, in_scenery
from gsedit.select.finder import Names
from gsedit.select.lift import lift
from gsedit.select.region import Region
from gsedit.words.colors import parse_hex
from gsedit.words.instruction import Change, Instruction
from rasterizer.camera import Camera
from rasterizer.numerics import AUTO, Execution
from rasterizer.scene import Gaussians

EXACT_ROUTES = ("tone", "paint", "material", "light", "scenery", "object")
SEEING_ROUTES = ("paint", "material", "light", "scenery")
"""Routes that weigh Gaussians by how much of them is seen."""
SEEN_VIEWS = 12
"""Most pictures that tell which Gaussians are seen."""
SEEN_PIXELS = 128
"""Longer side of these pictures."""


@dataclass(frozen=True, eq=False)
class Routed:
    """A scene that routes changed."""

    scene: Gaussians
    region: Region
    """Gaussians that any of the changes could reach, new ones among them."""
    notes: tuple[str, ...] = ()
    """Remarks for a person on how it was done."""
    before: Region | None = None
    """Gaussians of the scene before that are changed or gone; None where rows stay the same."""
    origin: Int[Tensor, " m"] | None = None
    """Row in the scene before of each Gaussian, NEW for a new one; None where rows stay."""


def is_exact(instruction: Instruction) -> bool:
    """Whether every change of an understood instruction has a route that does it exactly."""
    changes = instruction.changes
    return instruction.known and bool(changes) and all(c.route in EXACT_ROUTES for c in changes)


@cached_per_scene
def seen_weights(
    scene: Gaussians, cameras: Sequence[Camera], execution: Execution = AUTO
) -> Float[Tensor, " n"] | None:
    """How many pixels of small pictures from some of the cameras each Gaussian fills; None without
    cameras."""
    chosen = [cameras[i].fitted(SEEN_PIXELS) for i in evenly_spaced(len(cameras), SEEN_VIEWS)]
    ones = [torch.ones(camera.height, camera.width) for camera in chosen]
    return lift(scene, chosen, ones, execution).weight if chosen else None


def apply_change(
    scene: Gaussians,
    change: Change,
    region: Region,
    seen: Float[Tensor, " n"] | None = None,
    cameras: Sequence[Camera] = (),
    execution: Execution = AUTO,
) -> Gaussians:
    """The scene with one change on the Gaussians of a region; the others are the same bits.

    Paint and light weigh Gaussians by how much of them is `seen` (`seen_weights`; None: by their
    size); light comes from sides as the `cameras` see them.
    Raises UsageError for a region of no Gaussians, a route that is not exact, an unknown tone, an
    amount out of range, or a color that is none.
    """
    return _changed(scene, change, region, seen, cameras, execution).scene


def _changed(
    scene: Gaussians,
    change: Change,
    region: Region,
    seen: Float[Tensor, " n"] | None,
    cameras: Sequence[Camera],
    execution: Execution,
    shown: Bool[Tensor, " n"] | None = None,
) -> Dressed:
    """The scene as `apply_change` makes it, with remarks for a person."""
    if not region.inside.any():
        raise UsageError(Said(f"{change} would change no Gaussian", "select-change"))
    table, inside = table_of(scene), region.inside.cpu().numpy()
    match change.route:
        case "tone":
            after = toned(table, inside, change.name, change.amount, change.color)
        case "paint" | "material":
            return dressed(scene, change, region, seen, cameras, execution, shown)
        case "light":
            color = None if change.color is None else parse_hex(change.color)
            setup = setup_of(change.name, change.amount, color)
            return Dressed(relit(scene, setup, cameras, seen, region.inside, execution))
        case "scenery":
            return Dressed(in_scenery(scene, change.name, cameras, seen, region.inside, execution))
        case _:
            raise UsageError(f"{change} has no exact route: edit with --editor small")
    return Dressed(replace(scene, sh=torch.from_numpy(after.sh).to(scene.sh)))


def dressed(
    scene: Gaussians,
    change: Change,
    region: Region,
    seen: Float[Tensor, " n"] | None,
    cameras: Sequence[Camera],
    execution: Execution = AUTO,
    shown: Bool[Tensor, " n"] | None = None,
) -> Dressed:
    """The scene with the Gaussians of a region in a paint or material, see `in_material`. Raises
    UsageError as that does, and for a name that is no material or a color that is none."""
    if change.color is not None or change.route == "paint":
        parse_hex(change.color)
    if change.route == "paint":
        material = paint_of(change.name, str(change.color))
    else:
        material = material_of(change.name, change.color)
    if material is None:
        raise UsageError(
            f"there is no material {change.name!r}: gsedit list looks shows what there is"
        )
    return in_material(scene, region.inside, material, cameras, execution, seen, shown)


def apply_instruction(
    scene: Gaussians,
    instruction: Instruction,
    find_region: FindRegion,
    cameras: Sequence[Camera] = (),
    execution: Execution = AUTO,
    shown: Bool[Tensor, " n"] | None = None,
    find_named: FindNamed | None = None,
    names: Names | None = None,
) -> Routed:
    """The scene with every change of the instruction, in order; the subject is searched once.

    The cameras, if any, tell which Gaussians are seen: paint is adjusted to those. What is not
    `shown` (None: all is) may keep its old reflections, as for one picture. `find_named` finds what
    phrases name (None: each is what `find_region` finds), `names` tell which nouns it knows; all is
    found before anything is changed.
    Raises UsageError where a change has no exact route, InputError for a file that is no scene, and
    as `apply_change`, `apply_objects`, `find_region` do.
    """
    if not is_exact(instruction):
        raise UsageError(f"{instruction} has no exact route: edit with --editor small")
    changes = instruction.changes
    for change in changes:
        if change.name == "insert":
            open_scene(change.phrase)  # a file that is none is told before any work is done
    regions = regions_of(scene, changes, find_region, find_named, names)
    flags = {key: region.inside for key, region in regions.items()}
    flags["shown"] = torch.ones(len(scene), dtype=torch.bool) if shown is None else shown
    seeing = any(change.route in SEEING_ROUTES for change in changes)
    first = seen = seen_weights(scene, cameras, execution) if seeing else None
    total = same(scene)
    for change, *more in group_placements(changes):
        now = total.scene
        if change.route == "object":
            outcome = apply_objects(now, (change, *more), flags, cameras, execution)
            flags, seen = carry_masks(flags, change, outcome), None
        else:
            if seen is None and seeing:
                seen = seen_weights(now, cameras, execution)
            region = Region(flags[key_of(change)])
            part = None if shown is None else flags["shown"]
            made = _changed(now, change, region, seen, cameras, execution, part)
            outcome = Outcome(made.scene, torch.arange(len(now)), region.inside, made.notes)
        total = total.then(outcome)
    lit = any(map(_relights, changes))
    note = None if not lit else light_note(scene, place_of(scene, cameras, first), first)
    told = (*dict.fromkeys(total.notes), *((note,) if note else ()))
    return _routed(scene, changes, regions, replace(total, notes=told))


def _routed(
    scene: Gaussians, changes: Sequence[Change], regions: Mapping[str, Region], total: Outcome
) -> Routed:
    """The outcome of all changes of a scene, with the regions that they were in."""
    keys = dict.fromkeys(key_of(change) for change in changes if change.name != "insert")
    known = [regions[key] for key in keys if key in regions]
    notes, hows = (dict.fromkeys(map(attrgetter(name), known)) for name in ("note", "how"))
    sure = min((each.sure for each in known), default=1.0)
    found = Region(total.changed, "; ".join(notes) or "what is new", " or ".join(hows), sure)
    moved = any(change.route == "object" for change in changes)
    if not moved:
        return Routed(total.scene, found, total.notes)
    before = Region(_touched(total, len(scene)), found.note)
    return Routed(total.scene, found, total.notes, before, total.origin)


def _touched(outcome: Outcome, count: int) -> Bool[Tensor, " n"]:
    """Whether each of the `count` Gaussians before is changed or in the scene no longer."""
    touched = outcome.dropped(count)
    touched[outcome.origin[outcome.changed & (outcome.origin != NEW)]] = True
    return touched


def _relights(change: Change) -> bool:
    """Whether a change brings another light; autumn and a sketch do not."""
    scenic = change.route == "scenery" and SCENERIES[change.name].light is not None
    return change.route == "light" or scenic
