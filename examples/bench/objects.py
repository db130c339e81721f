"""Measure what removes, moves and changes objects, against exact results.

    python -m bench.objects [TASK ...]

Six staged scenes whose exact pictures with and without each thing are known. Right pictures are
drawn from as many Gaussians of the exact result: traced ones differ from splats everywhere.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from statistics import fmean

import torch
from jaxtyping import Bool, Float
from research.command import print_message, print_result
from torch import Tensor

from bench.object_cases import CASES, NOON, Case, placed
from bench.staged import Labelled, Stage
from gsedit.change.light.relight import relit
from gsedit.change.light.setup import LightSetup, Sun
from gsedit.change.materials.apply import in_material
from gsedit.change.materials.material import paint_of
from gsedit.change.objects.growth.grow import grow
from gsedit.change.objects.growth.places import GROWTHS, LEAST, MOST
from gsedit.change.objects.placing.insert import insert
from gsedit.change.objects.placing.place import place
from gsedit.change.objects.placing.placement import Placement
from gsedit.change.objects.removal.remove import remove
from gsedit.errors import GseditError
from gsedit.measures.formulas import NEAREST, psnr
from gsedit.scene.similarity import IDENTITY, Similarity
from gsedit.scene.table import gaussians_of, table_of
from gsedit.views.place import place_of
from rasterizer.camera import Camera
from rasterizer.render import render
from rasterizer.scene import Gaussians, concatenate

GAUSSIANS, SIDE = 24_000, 128
"""Gaussians of a scene; pixels a side of its pictures."""
UP = torch.tensor((0.0, 0.0, 1.0))
"""Upward direction of the scenes."""
CHANGES = 2 / 255
"""Difference of exact pictures that counts as a change."""
MARGIN = 2
"""Pixels around a change that count as changed: splats reach as far."""
COLUMNS = ("changed", "hole", "unseen", "outside")


@dataclass(frozen=True, eq=False)
class Given:
    """A case as an operation gets it, and its truth."""

    case: Case
    scene: Gaussians
    inside: Bool[Tensor, " n"]
    """The thing's Gaussians; none where it is inserted."""
    cameras: tuple[Camera, ...]
    other: Gaussians | None
    """The thing that is inserted: it stands at its origin, in another light."""
    before: Stage
    after: Stage
    truth: Gaussians


def given_of(case: Case, gaussians: int = GAUSSIANS, side: int = SIDE) -> Given:
    """Make a case's scene and its exact result."""
    before, after = case.before(), case.after()
    labelled = before.gaussians(gaussians)
    inside, other = torch.zeros(len(labelled.scene), dtype=torch.bool), None
    if case.task == "insertion":
        other = _alone(after, case, gaussians)
    else:
        inside = labelled.of(case.subject)
    part = labelled.scene[inside] if other is None else other
    truth = _truth(case, before, after, labelled, part)
    cameras = before.training(side)
    return Given(case, labelled.scene, inside, cameras, other, before, after, truth)


def _truth(case: Case, before: Stage, after: Stage, given: Labelled, part: Gaussians) -> Gaussians:
    """The Gaussians of the result: those given where they stay, and the moved ones of the thing."""
    truth = after.gaussians_from(before, given, len(given.scene))[0]
    if case.task not in ("move", "insertion"):
        return truth.scene
    moved = after.colored(gaussians_of(_similarity(case).table(table_of(part))))
    return concatenate(truth.scene[~truth.of(case.subject)], moved)


def _similarity(case: Case) -> Similarity:
    if case.task == "move":
        return placed(case.before(), case)
    return replace(IDENTITY, translation=case.after().thing(case.subject).foot)


def _alone(after: Stage, case: Case, gaussians: int) -> Gaussians:
    """The thing as another capture has it: at the origin, in another light."""
    thing = after.thing(case.subject)
    to_origin = replace(IDENTITY, translation=-thing.foot)
    alone = replace(after, setting=(), things=(thing.moved(to_origin),), light=NOON)
    return alone.gaussians(gaussians // 8).scene


def _inserted(given: Given) -> Gaussians:
    assert given.other is not None
    thing = given.after.thing(given.case.subject)
    at = tuple(thing.foot.tolist())
    return insert(given.scene, given.other, at, given.cameras, height=thing.height, up=UP).scene


def _placed(given: Given) -> Gaussians:
    x, y, z = given.case.change["to"]
    asked = Placement(given.case.change["scale"], given.case.change["turn_degrees"], to=(x, y, z))
    return place(given.scene, given.inside, asked, given.cameras).scene


def _painted(given: Given) -> Gaussians:
    red, green, blue = (round(255 * each) for each in given.case.change["color"])
    paint = paint_of("paint", f"#{red:02x}{green:02x}{blue:02x}")
    return in_material(given.scene, given.inside, paint, given.cameras).scene


def _relit(given: Given) -> Gaussians:
    asked = given.case.change
    seen = place_of(given.scene, given.cameras)
    toward = torch.nn.functional.normalize(torch.tensor(asked["sun"]).double(), dim=0)
    elevation = float(torch.rad2deg(torch.asin(toward @ seen.up)))
    azimuths = torch.arange(-180.0, 180.0)
    level = torch.stack([seen.direction(float(a), elevation) for a in azimuths])
    azimuth = float(azimuths[(level @ toward).argmax()])
    strength = max(asked["sunlight"])
    red, green, blue = (each / strength for each in asked["sunlight"])
    sun = Sun(azimuth, elevation, strength, (red, green, blue))
    setup = LightSetup(tuple(asked["sky"]), tuple(asked["ground"]), sun)
    return relit(given.scene, setup, given.cameras)


def _grown(given: Given) -> Gaussians:
    part = given.scene.means[given.inside]
    size = float((part.amax(0) - part.amin(0)).norm())
    amount = given.case.change["thickness"] / (GROWTHS["snow"].thickness * size)
    amount = min(max(amount, LEAST), MOST)
    return grow(given.scene, "snow", amount, given.inside, given.cameras).scene


METHODS: dict[str, Callable[[Given], Gaussians]] = {
    "removal": lambda given: remove(given.scene, given.inside, given.cameras).scene,
    "insertion": _inserted,
    "move": _placed,
    "recolor": _painted,
    "relight": _relit,
    "growth": _grown,
}
"""gsedit's operation for each task."""


def scores(given: Given, result: Gaussians, side: int = SIDE) -> dict[str, float]:
    """PSNR in dB at the held-out views by the names of COLUMNS, without those of no pixels.

    Changed pixels are compared with the right pictures, all others with the scene before.
    """
    cameras = given.after.held_out(side)
    made, right, old = (_drawn(each, cameras) for each in (result, given.truth, given.scene))
    exact = [torch.stack([s.photo(c) for c in cameras]) for s in (given.before, given.after)]
    changed = _widened((exact[1] - exact[0]).abs().amax(-1) > CHANGES)
    found = {"changed": (right, changed), "outside": (old, ~changed)}
    if given.case.task == "removal":
        holes = [_hole(given, camera) for camera in cameras]
        found |= {"hole": (right, torch.stack([hole for hole, _ in holes]))}
        found |= {"unseen": (right, torch.stack([unseen for _, unseen in holes]))}
    return {
        name: min(psnr(made, target, mask), NEAREST)
        for name, (target, mask) in found.items()
        if mask.any()
    }


def _drawn(scene: Gaussians, cameras: Sequence[Camera]) -> Float[Tensor, "v h w 3"]:
    with torch.no_grad():
        return torch.stack([render(scene, each).color.clamp(0, 1) for each in cameras])


def _widened(mask: Bool[Tensor, "v h w"]) -> Bool[Tensor, "v h w"]:
    size = 2 * MARGIN + 1
    return torch.nn.functional.max_pool2d(mask[:, None].float(), size, 1, MARGIN)[:, 0] > 0


def _hole(given: Given, camera: Camera) -> tuple[Bool[Tensor, "h w"], Bool[Tensor, "h w"]]:
    """Pixels that show the thing before, and those of them whose surface after nobody saw."""
    hole = given.before.mask(camera, given.case.subject)
    traced = given.after.scene.trace(camera)
    asked = hole & traced.hit
    points = camera.unproject(camera.pixel_centers()[asked], traced.depth[asked])
    seen = torch.zeros(len(points), dtype=torch.bool)
    for each in given.cameras:
        seen |= given.before.scene.visible(points, each)
    unseen = torch.zeros_like(hole)
    unseen[asked] = ~seen
    return hole, unseen


def table(rows: Sequence[tuple[str, dict[str, float]]]) -> str:
    """A Markdown table of cases, with the means of each task."""
    tasks = dict.fromkeys(name.split("-")[0] for name, _ in rows)
    lines = [f"| case | {' | '.join(COLUMNS)} | CPU s |", "|---" * (len(COLUMNS) + 2) + "|"]
    for task in tasks:
        own = [(name, found) for name, found in rows if name.split("-")[0] == task]
        keys = {key for _, found in own for key in found}
        means = {key: fmean(f[key] for _, f in own if key in f) for key in keys}
        for name, found in (*own, (f"**{task}, mean**", means)):
            cells = [f"{found[key]:.1f}" if key in found else "" for key in (*COLUMNS, "cpu")]
            lines.append(f"| {name} | {' | '.join(cells)} |")
    return "\n".join(lines)


def main(tasks: Sequence[str]) -> None:
    """Measure the cases of some tasks, or of all, and print a table."""
    rows: list[tuple[str, dict[str, float]]] = []
    for case in CASES:
        if tasks and case.task not in tasks:
            continue
        given = given_of(case)
        began = time.process_time()
        try:
            result = METHODS[case.task](given)
        except GseditError as error:
            print_message(f"{case.name}: refused: {error}")
            continue
        seconds = time.process_time() - began
        rows.append((case.name, {**scores(given, result), "cpu": seconds}))
        print_message(f"{case.name}: {seconds:.1f} s")
    print_result(table(rows))


if __name__ == "__main__":
    main(sys.argv[1:])
