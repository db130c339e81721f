"""Painters: each makes changes of one route on the Gaussians themselves, exactly.

A painter has the scene as it is now, a run of changes that are done at once, the flags of the parts
that changes name, and how the scene is looked at; it gives an `Outcome`. What a 2D editor draws
is drawn by `gsedit.paper.draw`, which `gsedit.editing.edit` calls. `n` Gaussians.

Tones (brightness, contrast, saturation and their like) are affine in display colors and so exact
from every direction: matrices of gsedit.toolkit.grade and of the W3C's filter effects
(https://www.w3.org/TR/filter-effects-1). Shadows, highlights and sharpness of detail are no one
map of colors.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from math import isfinite, log2
from typing import cast

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.change import objects
from gsedit.change.light.relight import relit
from gsedit.change.light.setup import setup_of
from gsedit.change.materials.apply import in_material
from gsedit.change.materials.material import material_of, paint_of
from gsedit.change.objects.growth.grow import grow
from gsedit.change.objects.growth.places import FALLS
from gsedit.change.objects.placing.placement import Placement, RelativePlace, Side
from gsedit.change.scenery.effects import SCENERIES, in_scenery
from gsedit.editing.parts import Parts
from gsedit.editing.plan import COPY, key_of, runs_of
from gsedit.errors import Said, UsageError
from gsedit.formats.scenes import load
from gsedit.scene.cache import cached, cached_per_scene
from gsedit.scene.color_space import LUMINANCE
from gsedit.scene.neighbors import nearest
from gsedit.scene.outcome import Outcome
from gsedit.scene.table import SplatTable, table_of
from gsedit.select.finder import Finder
from gsedit.select.region import lift
from gsedit.toolkit.grade import COLDEST, GAMMA, HOTTEST, NEUTRAL, Affine, Grade
from gsedit.toolkit.recolor import recolored
from gsedit.views.cameras_json import cameras_file, read_cameras
from gsedit.views.dataset import evenly_spaced
from gsedit.views.paths import up_of
from gsedit.views.place import light_note, place_of
from gsedit.views.viewpoints import that_see
from gsedit.words.colors import parse_hex
from gsedit.words.instruction import MOST, Change, Instruction, Place
from gsedit.words.phrases import GROUNDS
from gsedit.words.refusals import REASONS
from rasterizer.camera import Camera
from rasterizer.numerics import color_to_sh, sh_to_color
from rasterizer.scene import Gaussians

GAIN = 2.0
"""Largest factor less 1 of the deepest shadow, or the brightest light, for each share."""
NEAR = 16
"""Gaussians around one whose mean color its detail is told from."""
DETAIL = 3.0
"""Times that detail is added for each share: 30 % sharper nearly doubles it."""

Gains = Callable[[Float[Tensor, " n"], float], Float[Tensor, " n"]]


CURVES: dict[str, Gains] = {
    "shadows": lambda luma, share: 1 + GAIN * share * (1 - luma) ** 3,
    "highlights": lambda luma, share: 1 + GAIN / 2 * share * luma**3,
}
"""Factors of colors by their luma: dark ones change and light ones stay, or the other way round."""
LOCAL = (*CURVES, "sharpness")
"""Names of the tones of this file."""


def locally_toned(
    scene: Gaussians, inside: Bool[Tensor, " n"], name: str, amount: float | None
) -> Gaussians:
    """Change shadows, highlights or sharpness of the Gaussians inside; others keep their bits.

    Raises UsageError for a share out of range.
    """
    share = DEFAULT_SHARE if amount is None else amount
    if not -1 <= share <= MOST["tone"]:
        raise UsageError(f"{name} by {share:+.0%} is out of range: say a share from -100% to 500%")
    sh = scene.sh.clone()
    base = sh_to_color(sh[inside, 0])
    if name == "sharpness":
        _, beside = nearest(scene.means[inside].detach().cpu().numpy(), NEAR)
        detail = base - base[torch.from_numpy(beside)].mean(1) if beside.size else 0 * base
        factor = max(DETAIL * share, -1.0)
        sh[inside, 0] = color_to_sh((base + factor * detail).clamp(0.0, 1.0))
    else:
        luma = (base.clamp(0, 1) @ base.new_tensor(LUMINANCE)).clamp(0, 1)
        gain = CURVES[name](luma, share).clamp_min(0.0)
        sh[inside] *= gain[:, None, None]
        sh[inside, 0] = color_to_sh(base * gain[:, None])
    return replace(scene, sh=sh)


Flags = Mapping[str, Bool[Tensor, " n"]]
"""Flags of the Gaussians of what a change can name, by `key_of` and by phrase."""
OFFSETS = {
    "left": (-1, 0, 0), "right": (1, 0, 0), "forward": (0, -1, 0), "back": (0, 1, 0),
    "down": (0, 0, -1), "up": (0, 0, 1),
}  # fmt: skip
"""Right, back and up of each way to go."""


def paint_objects(
    scene: Gaussians, run: Sequence[Change], flags: Flags, cameras: Sequence[Camera] = ()
) -> Outcome:
    """Make a run of changes of one object: what is done at once, see `runs_of`.

    Raises UsageError where what changes is empty or the whole scene, and as the operations do;
    InputError for a file that holds no scene.
    """
    change = run[0]
    if change.name == "insert":
        return _insert(scene, run, flags, cameras)
    inside = flags[key_of(change)]
    if change.kind == "growth":
        _check(change, inside, whole=True)
        among = None if inside.all() else inside
        return objects.grow(scene, change.name, 1 + (change.amount or 0), among, cameras)
    _check(change, inside, whole=change.name in (COPY, "scale", "turn"))
    if change.name == "remove" and change.target == "background":
        return _without(scene, inside)
    if change.name == "remove":
        return objects.remove(scene, inside, cameras)
    if any(each.place is not None and each.place.metres for each in run):
        raise UsageError(REASONS["distance"])
    placement = Placement()
    for each in run:
        placement = _placed(placement, each, flags, key_of(change))
    made = objects.place(scene, inside, placement, cameras)
    if change.name != COPY or not isinstance(placement.to, RelativePlace):
        return made
    again = replace(placement, to=RelativePlace(placement.to.side, None))
    size = len(made.scene) - len(scene)
    for _ in range(1, int(change.amount or 1)):  # each copy beside the one before
        last = torch.arange(len(made.scene)) >= len(made.scene) - size
        made = made.then(objects.place(made.scene, last, again, cameras))
    return made


def _check(change: Change, inside: Bool[Tensor, " n"], *, whole: bool) -> None:
    """Raise UsageError for no Gaussians, and for all of them unless `whole` may be."""
    if not inside.any():
        raise UsageError(Said(f"{change}: nothing of it is in the scene", "select-object"))
    if inside.all() and not whole:
        raise UsageError(Said(f"{change}: the region is the whole scene", "select-less"))


def _without(scene: Gaussians, inside: Bool[Tensor, " n"]) -> Outcome:
    """The scene without some Gaussians; nothing is filled."""
    rows = torch.nonzero(~inside).flatten()
    return Outcome(
        scene[rows], rows, torch.zeros(len(rows), dtype=torch.bool),
        (f"{int(inside.sum()):,} Gaussians are left out, nothing is put in their place",),
    )  # fmt: skip


def _placed(placement: Placement, change: Change, flags: Flags, own: str) -> Placement:
    """A placement with one change more; `own` is the key of what is placed."""
    amount, to = change.amount or 0.0, change.place
    if change.name == "scale":
        return replace(placement, scale=1 + amount)
    if change.name == "turn":
        return replace(placement, turn=360 * amount)
    if to is None or to.of:
        return replace(placement, to=_beside(to, flags, own), copy=change.name == COPY)
    far = 0.5 if change.amount is None else amount  # of its size: plainly seen, and still in view
    right, back, up = (far * each for each in OFFSETS[to.side])
    return replace(placement, offset=(right, back, up), unit=1.0 if to.units else None)


def _beside(place: Place | None, flags: Flags, own: str | None) -> RelativePlace | None:
    """The place as `gsedit.change.objects.placing` has it; `own` is the key of what is placed."""
    if place is None:
        return None
    of = "subject" if place.of == "it" else place.of
    side = cast("Side", place.side)  # a place of something is no mere way
    return RelativePlace(side, None if of == own else flags[of])


def _insert(
    scene: Gaussians, run: Sequence[Change], flags: Flags, cameras: Sequence[Camera]
) -> Outcome:
    """The scene with the object of a file put in.

    It is the subject, and upright, as the cameras beside its file see it, if there are some.
    """
    change, turn = run[0], 360 * sum(each.amount or 0.0 for each in run[1:])
    where, beside = change.place, cameras_file(change.phrase)
    other, up = load(change.phrase), None
    if beside is not None:
        viewpoints = that_see(read_cameras(beside), other)
        if viewpoints:
            up = up_of([each.camera for each in viewpoints])
            other = other[Finder(other, viewpoints).subject.inside]
    if where and where.side == "on" and where.of in GROUNDS:
        where = None  # anywhere on it, not its middle
    at = _beside(where, flags, None)
    return objects.insert(scene, other, at, cameras, turn=turn, up=up)


SEEN_VIEWS = 12
"""Most pictures that tell which Gaussians are seen."""
SEEN_PIXELS = 128
"""Longer side of these pictures."""


@dataclass(frozen=True, eq=False)
class Looking:
    """How painters look at a scene."""

    cameras: Sequence[Camera] = ()
    """Cameras that tell sides, light, and which Gaussians are seen."""
    coarse: bool = False
    """Whether the scene holds groups of Gaussians: no discs are laid on them."""


Painter = Callable[[Gaussians, Sequence[Change], Flags, Looking], Outcome]


@cached_per_scene
def seen_weights(scene: Gaussians, cameras: Sequence[Camera]) -> Float[Tensor, " n"] | None:
    """How many pixels of small pictures from some of the cameras each Gaussian fills; None without
    cameras."""
    chosen = [cameras[i].fitted(SEEN_PIXELS) for i in evenly_spaced(len(cameras), SEEN_VIEWS)]
    ones = [torch.ones(camera.height, camera.width) for camera in chosen]
    return lift(scene, chosen, ones).weight if chosen else None


def paint_tone(scene: Gaussians, run: Sequence[Change], flags: Flags, looking: Looking) -> Outcome:
    """Change brightness, contrast, saturation and their like: see `gsedit.editing.painters`."""
    (change,), inside = run, _inside(run[0], flags)
    if change.name in LOCAL:
        return _recolored(locally_toned(scene, inside, change.name, change.amount), inside)
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
    seen, shown = seen_weights(scene, looking.cameras), flags.get("shown")
    return in_material(
        scene, inside, material, looking.cameras, seen, shown,
        discs=not looking.coarse,
    )  # fmt: skip


def paint_light(scene: Gaussians, run: Sequence[Change], flags: Flags, looking: Looking) -> Outcome:
    """Light a part anew, from sides as the cameras see them."""
    (change,), inside = run, _inside(run[0], flags)
    color = None if change.color is None else parse_hex(change.color)
    setup, seen = setup_of(change.name, change.amount, color), seen_weights(scene, looking.cameras)
    lit = relit(scene, setup, looking.cameras, seen, inside)
    return _recolored(lit, inside, *_light_notes(scene, looking))


def paint_scenery(
    scene: Gaussians, run: Sequence[Change], flags: Flags, looking: Looking
) -> Outcome:
    """Bring weather, seasons, water or a drawing over a part; over all, snow lies as a layer,
    but on groups."""
    (change,), inside = run, _inside(run[0], flags)
    if change.name in FALLS and bool(inside.all()) and not looking.coarse:
        shown = flags.get("shown", inside)
        with cached(scene), suppress(UsageError):  # it may lie nowhere
            some = None if shown.all() else shown
            return grow(scene, FALLS[change.name], cameras=looking.cameras, shown=some)
    seen = seen_weights(scene, looking.cameras)
    made = in_scenery(scene, change.name, looking.cameras, seen, inside)
    lit = SCENERIES[change.name].light is not None  # autumn brings none
    return _recolored(made, inside, *(_light_notes(scene, looking) if lit else ()))


PAINTERS: Mapping[str, Painter] = {
    "tone": paint_tone,
    "paint": paint_material,
    "material": paint_material,
    "light": paint_light,
    "scenery": paint_scenery,
    "object": lambda scene, run, flags, looking: paint_objects(scene, run, flags, looking.cameras),
}
"""The painter of each route that is exact."""


def painted(
    step: Instruction, parts: Parts, total: Outcome, looking: Looking
) -> tuple[Parts, Outcome]:
    """The parts and the outcome after an exact step too, from those before it."""
    for run in runs_of(step):
        made = PAINTERS[run[0].route](total.scene, run, parts.flags, looking)
        parts, total = parts.after(run[0], made), total.then(made)
    return parts, total


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
    seen = seen_weights(scene, looking.cameras)
    note = light_note(scene, place_of(scene, looking.cameras, seen), seen)
    return () if note is None else (note,)


DEFAULT_SHARE = 0.3
"""Share of a change without a number: plainly seen, and far from the ends."""
WHOLE = 1.0
"""Share of a change that is all or nothing: grayscale, sepia, negative."""
DARKEST_STOPS = -20.0
"""Stops that stand for no light: a display color of 1 becomes half of an 8-bit step."""
WARMEST = 4.0
"""Factor of kelvin at a share of 1, its inverse at -1: the range of `Grade.temperature`."""
SEPIA = ((0.393, 0.769, 0.189), (0.349, 0.686, 0.168), (0.272, 0.534, 0.131))


def toned(
    table: SplatTable,
    inside: Bool[np.ndarray, " n"],
    name: str,
    amount: float | None,
    color: str | None = None,
) -> SplatTable:
    """Change the tone of the Gaussians inside; the others' coefficients are the same bits.

    Raises UsageError for an unknown name, an amount out of range, or a color that is none.
    """
    return recolored(table, inside, tone_map(name, amount, color))


def tone_map(name: str, amount: float | None, color: str | None = None) -> Affine:
    """The map of display colors of a tone and its signed share. Raises as `toned`."""
    if name not in TONES:
        raise UsageError(f"there is no tone {name!r}: choose one of {', '.join(TONES)}")
    make, default, least = TONES[name]
    share = default if amount is None else amount
    most = MOST["tone"]
    if not (isfinite(share) and least <= share <= most):
        raise UsageError(
            f"{name} by {share:+.0%} is out of range: say a share from {least:+.0%} to {most:+.0%}"
        )
    if name == "hue" and color is not None:
        return _tint(share, color)
    return make(share)


def _warmth(share: float) -> Affine:
    kelvin = NEUTRAL * WARMEST**share
    return Grade(temperature=min(max(kelvin, COLDEST), HOTTEST)).affine


def _mixed(matrix: np.ndarray, offset: np.ndarray, share: float) -> Affine:
    """The share of the way from no change to an affine map."""
    share = min(share, 1.0)
    return Affine((1 - share) * np.eye(3) + share * matrix, share * offset)


def _tint(share: float, color: str) -> Affine:
    """Mix colors with their luma in the color, which keeps the luma of gray."""
    target = np.maximum(parse_hex(color), 1 / 255)
    return _mixed(np.outer(target / (LUMINANCE @ target), LUMINANCE), np.zeros(3), share)


TONES: dict[str, tuple[Callable[[float], Affine], float, float]] = {
    "brightness": (
        lambda share: Grade(exposure=max(GAMMA * log2(max(1 + share, 1e-9)), DARKEST_STOPS)).affine,
        DEFAULT_SHARE,
        -1.0,
    ),
    "contrast": (lambda share: Grade(contrast=1 + share).affine, DEFAULT_SHARE, -1.0),
    "saturation": (lambda share: Grade(saturation=1 + share).affine, DEFAULT_SHARE, -1.0),
    "warmth": (_warmth, DEFAULT_SHARE, -1.0),
    "hue": (lambda share: Grade(hue=360 * share).affine, DEFAULT_SHARE, -1.0),
    "grayscale": (lambda share: Grade(saturation=1 - min(share, 1)).affine, WHOLE, 0.0),
    "sepia": (lambda share: _mixed(np.array(SEPIA), np.zeros(3), share), WHOLE, 0.0),
    "negative": (lambda share: _mixed(-np.eye(3), np.ones(3), share), WHOLE, 0.0),
}
"""Tones by name: (map of a share, share without a number, least share)."""
