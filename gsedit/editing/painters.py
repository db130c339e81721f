"""Painters: each makes changes of one route on the Gaussians themselves, exactly.

A painter has the scene as it is now, a run of changes that are done at once, the flags of the parts
that changes name, and how the scene is looked at; it gives an `Outcome`. What a 2D editor draws
is drawn by `gsedit.paper.draw`, which `gsedit.editing.edit` calls. `n` Gaussians.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.change.light.relight import relit
from gsedit.change.light.table import setup_of
from gsedit.change.materials.apply import in_material
from gsedit.change.materials.table import material_of, paint_of
from gsedit.change.scenery.table import SCENERIES, in_scenery
from gsedit.editing.placements import Flags, paint_objects
from gsedit.editing.plan import key_of
from gsedit.editing.tone import toned
from gsedit.errors import Said, UsageError
from gsedit.scene.cache import cached_per_scene
from gsedit.scene.outcome import Outcome
from gsedit.scene.table import table_of
from gsedit.select.region import lift
from gsedit.views.dataset import evenly_spaced
from gsedit.views.place import light_note, place_of
from gsedit.words.colors import parse_hex
from gsedit.words.instruction import Change
from rasterizer.camera import Camera
from rasterizer.numerics import AUTO, Execution
from rasterizer.scene import Gaussians

SEEN_VIEWS = 12
"""Most pictures that tell which Gaussians are seen."""
SEEN_PIXELS = 128
"""Longer side of these pictures."""


@dataclass(frozen=True, eq=False)
class Looking:
    """How painters look at a scene."""

    cameras: Sequence[Camera] = ()
    """Cameras that tell sides, light, and which Gaussians are seen."""
    execution: Execution = AUTO

    def seen(self, scene: Gaussians) -> Float[Tensor, " n"] | None:
        """How many pixels of small pictures each Gaussian fills; None without cameras."""
        return seen_weights(scene, self.cameras, self.execution)


Painter = Callable[[Gaussians, Sequence[Change], Flags, Looking], Outcome]


@cached_per_scene
def seen_weights(
    scene: Gaussians, cameras: Sequence[Camera], execution: Execution = AUTO
) -> Float[Tensor, " n"] | None:
    """How many pixels of small pictures from some of the cameras each Gaussian fills; None without
    cameras."""
    chosen = [cameras[i].fitted(SEEN_PIXELS) for i in evenly_spaced(len(cameras), SEEN_VIEWS)]
    ones = [torch.ones(camera.height, camera.width) for camera in chosen]
    return lift(scene, chosen, ones, execution).weight if chosen else None


def paint_tone(scene: Gaussians, run: Sequence[Change], flags: Flags, looking: Looking) -> Outcome:
    """Change brightness, contrast, saturation and their like: see `gsedit.editing.tone`."""
    (change,), inside = run, _inside(run[0], flags)
    table = table_of(scene)
    after = toned(table, inside.cpu().numpy(), change.name, change.amount, change.color)
    return _recolored(replace(scene, sh=torch.from_numpy(after.sh).to(scene.sh)), inside)


def paint_material(
    scene: Gaussians, run: Sequence[Change], flags: Flags, looking: Looking
) -> Outcome:
    """Put a part in a paint or material, see `in_material`.

    Raises UsageError as that does, and for a name that is no material or a color that is none.
    """
    (change,), inside = run, _inside(run[0], flags)
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
    seen, shown = looking.seen(scene), flags.get("shown")
    return in_material(scene, inside, material, looking.cameras, looking.execution, seen, shown)


def paint_light(scene: Gaussians, run: Sequence[Change], flags: Flags, looking: Looking) -> Outcome:
    """Light a part anew, from sides as the cameras see them."""
    (change,), inside = run, _inside(run[0], flags)
    color = None if change.color is None else parse_hex(change.color)
    setup, seen = setup_of(change.name, change.amount, color), looking.seen(scene)
    lit = relit(scene, setup, looking.cameras, seen, inside, looking.execution)
    return _recolored(lit, inside, *_light_notes(scene, looking))


def paint_scenery(
    scene: Gaussians, run: Sequence[Change], flags: Flags, looking: Looking
) -> Outcome:
    """Bring weather, seasons, water or a drawing over a part."""
    (change,), inside = run, _inside(run[0], flags)
    seen = looking.seen(scene)
    made = in_scenery(scene, change.name, looking.cameras, seen, inside, looking.execution)
    lit = SCENERIES[change.name].light is not None  # autumn and a sketch bring none
    return _recolored(made, inside, *(_light_notes(scene, looking) if lit else ()))


PAINTERS: Mapping[str, Painter] = {
    "tone": paint_tone,
    "paint": paint_material,
    "material": paint_material,
    "light": paint_light,
    "scenery": paint_scenery,
    "object": lambda scene, run, flags, looking: paint_objects(
        scene, run, flags, looking.cameras, looking.execution
    ),
}
"""The painter of each route that is exact."""


def _inside(change: Change, flags: Flags) -> Bool[Tensor, " n"]:
    """The Gaussians that a change is about. Raises UsageError for none."""
    inside = flags[key_of(change)]
    if not inside.any():
        raise UsageError(Said(f"{change} would change no Gaussian", "select-change"))
    return inside


def _recolored(scene: Gaussians, inside: Bool[Tensor, " n"], *notes: str) -> Outcome:
    """The outcome of a change of the colors of some Gaussians."""
    return Outcome(scene, torch.arange(len(scene)), inside, notes)


def _light_notes(scene: Gaussians, looking: Looking) -> tuple[str, ...]:
    """Remark on what of a scene another light hardly reaches, if there is any."""
    seen = looking.seen(scene)
    note = light_note(scene, place_of(scene, looking.cameras, seen), seen)
    return () if note is None else (note,)
