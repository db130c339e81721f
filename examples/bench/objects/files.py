"""Scenes and exact pictures of the benchmark as files that anyone can read.

In scenes/NAME/: scene.ply; labels.npy, the number of its thing a Gaussian, and names.json; capture/
with photos and transforms.json (nerfstudio). In cases/NAME/: case.json; inside.npy, flags of the
thing's Gaussians; held_out/ with the right pictures and transforms.json; changed/, hole/ and
unseen/ with masks of those names; truth.ply, whose pictures are right; other.ply where something is
inserted.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from bench.objects.cases import NOON, Case, placed
from bench.objects.scores import Truth, changes
from bench.staged import Labelled, Stage
from gsedit.datasets.dataset import View
from gsedit.datasets.view_list_files import ViewList, read_view_list, write_view_list
from gsedit.datasets.viewpoints import Viewpoint
from gsedit.errors import UsageError
from gsedit.fitting.solve import solve_colors
from gsedit.formats.flags import read_flags, write_flags
from gsedit.formats.pictures import as_picture, read_picture, save_picture
from gsedit.formats.scenes import load, save
from gsedit.runs.json_lines import write_record
from gsedit.scene.similarity import IDENTITY, Similarity
from gsedit.scene.table import gaussians_of, table_of
from gsedit.storage.json_files import read_json
from rasterizer.camera import Camera
from rasterizer.render import render
from rasterizer.scene import Gaussians, concatenate

CAMERAS = "transforms.json"


@dataclass(frozen=True)
class Size:
    """How large the scenes and their pictures are."""

    gaussians: int = 24_000
    """About the number of Gaussians of a scene."""
    side: int = 128
    """Pixels a side of pictures."""
    fitted: bool = False
    """Whether colors are fitted to the photos, and right pictures are traced."""


@dataclass(frozen=True, eq=False)
class Given:
    """A case as whoever takes part reads it."""

    case: Case
    change: dict[str, Any]
    """Numbers of the change, as case.json has them."""
    scene: Gaussians
    inside: Bool[Tensor, " n"]
    """The thing's Gaussians; none where it is inserted."""
    cameras: tuple[Camera, ...]
    held_out: tuple[Camera, ...]
    truth: Truth
    other: Gaussians | None
    """The thing that is inserted: it stands at its origin."""


def scene_folder(folder: Path, case: Case) -> Path:
    """The folder of the scene that a case begins with."""
    without = f"-without-{case.subject.replace(' ', '-')}" if case.task == "insertion" else ""
    return folder / "scenes" / f"{case.stage}{without}"


def check_size(folder: Path, size: Size) -> None:
    """Say in a folder what size its scenes have; UsageError where they have another."""
    path = folder / "size.json"
    if not path.is_file():
        write_record(size, path)
    elif read_json(path) != asdict(size):
        raise UsageError(f"{folder} holds scenes of another size or kind: give another folder")


def write_scene(stage: Stage, folder: Path, size: Size) -> None:
    """Write a stage with photos of it; nothing where that was done."""
    if (folder / "names.json").is_file():
        return
    cameras = stage.training(size.side)
    photos = [stage.photo(camera) for camera in cameras]
    _write_views(folder / "capture", cameras, photos)
    given = stage.gaussians(size.gaussians, sh_degree=int(size.fitted))
    if size.fitted:
        given = replace(given, scene=_fitted(given.scene, cameras, photos))
    save(given.scene, folder / "scene.ply", overwrite=True)
    np.save(folder / "labels.npy", given.labels.numpy())
    write_record(list(given.names), folder / "names.json")


def _fitted(
    scene: Gaussians, cameras: Sequence[Camera], photos: Sequence[Float[Tensor, "h w 3"]]
) -> Gaussians:
    """The scene in the colors that explain photos best, which differ from side to side."""
    views = [View(_name(i), camera, each) for i, (camera, each) in enumerate(zip(cameras, photos))]
    everything = torch.ones(len(scene), dtype=torch.bool)
    return deque(solve_colors(scene, views, everything), maxlen=1).pop().scene


def read_labelled(folder: Path) -> Labelled:
    """The Gaussians of a scene's folder, and whose they are."""
    labels = torch.from_numpy(np.load(folder / "labels.npy"))
    return Labelled(load(folder / "scene.ply"), labels, tuple(read_json(folder / "names.json")))


def write_case(case: Case, folder: Path, size: Size) -> None:
    """Write a case, and its scene, under a folder; nothing where that was done."""
    own, source = folder / "cases" / case.name, scene_folder(folder, case)
    before, after = case.before(), case.after()
    write_scene(before, source, size)
    if (own / "case.json").is_file():
        return
    given, other = read_labelled(source), None
    inside = torch.zeros(len(given.scene), dtype=torch.bool)
    if case.task == "insertion":
        other = _alone(after, case, size)
        save(other, own / "other.ply", overwrite=True)
    else:
        inside = given.of(case.subject)
    own.mkdir(parents=True, exist_ok=True)
    write_flags(inside.numpy(), own / "inside.npy", overwrite=True)
    cameras = after.held_out(size.side)
    traced = [torch.stack([s.photo(camera) for camera in cameras]) for s in (before, after)]
    right = traced[1]
    if not size.fitted:
        part = given.scene[inside] if other is None else other
        truth = _truth(case, before, after, given, part)
        save(truth, own / "truth.ply", overwrite=True)
        right = torch.stack([render(truth, each).color.detach().clamp(0, 1) for each in cameras])
    _write_views(own / "held_out", cameras, list(right))
    training = before.training(size.side)
    holes = [_hole(before, after, case, camera, training) for camera in cameras]
    masks = {"changed": changes(*traced)}
    masks |= {name: torch.stack(each) for name, each in zip(("hole", "unseen"), zip(*holes))}
    for name, mask in masks.items():
        for i, picture in enumerate(mask[..., None].expand(-1, -1, -1, 3).float()):
            save_picture(as_picture(picture), own / name / _name(i), overwrite=True)
    asked = {**case.change, **_derived(case, before, after)}
    record = {**asdict(replace(case, change=asked)), "scene": f"../../scenes/{source.name}"}
    write_record(record, own / "case.json")


def _truth(case: Case, before: Stage, after: Stage, given: Labelled, part: Gaussians) -> Gaussians:
    """The Gaussians of the result: those given where they stay, and the moved ones of the thing."""
    truth = after.gaussians_from(before, given, len(given.scene))[0]
    if case.task not in ("move", "insertion"):
        return truth.scene
    moved = after.colored(gaussians_of(place_of(case).table(table_of(part))))
    return concatenate(truth.scene[~truth.of(case.subject)], moved)


def read_case(case: Case, folder: Path) -> Given:
    """A case as it was written under a folder. Raises InputError for files that are not there."""
    own, source = folder / "cases" / case.name, scene_folder(folder, case)
    scene = load(source / "scene.ply")
    held_out = _cameras(own / "held_out")
    after, *masks = (
        torch.stack([read_picture(own / name / _name(i)) for i in range(len(held_out))])
        for name in ("held_out", "changed", "hole", "unseen")
    )
    truth = Truth(after, *(mask[..., 0] > 0.5 for mask in masks))
    inside = torch.from_numpy(read_flags(own / "inside.npy", len(scene)))
    other = load(own / "other.ply") if (own / "other.ply").is_file() else None
    asked = read_json(own / "case.json")["change"]
    return Given(case, asked, scene, inside, _cameras(source / "capture"), held_out, truth, other)


def place_of(case: Case) -> Similarity:
    """The similarity that brings the thing's Gaussians to where they belong."""
    if case.task == "move":
        return placed(case.before(), case)
    if case.task == "insertion":
        return replace(IDENTITY, translation=case.after().thing(case.subject).foot)
    return IDENTITY


def _derived(case: Case, before: Stage, after: Stage) -> dict[str, Any]:
    """Numbers of a change that follow from the scene."""
    if case.task == "insertion":
        thing = after.thing(case.subject)
        return {"at": thing.foot.tolist(), "height": thing.height}
    if case.task == "deform":
        thing = before.thing(case.subject)
        shares = torch.tensor((0.0, 1 / 3, 2 / 3, 1.0)).double()[:, None]
        up = torch.tensor((0.0, 0.0, thing.height)).double()
        points = torch.from_numpy(thing.foot) + shares * up
        targets = thing.bend_points(points, case.change["degrees"])
        return {"handles": torch.stack((points, targets), 1).tolist()}
    if case.task == "relight":
        light = before.light
        return {"now": {name: list(getattr(light, name)) for name in case.change}}
    return {}


def _alone(after: Stage, case: Case, size: Size) -> Gaussians:
    """The thing as another capture has it: at the origin, in another light."""
    thing = after.thing(case.subject)
    to_origin = replace(IDENTITY, translation=-thing.foot)
    alone = replace(after, setting=(), things=(thing.moved(to_origin),), light=NOON)
    return alone.gaussians(size.gaussians // 8).scene


def _hole(
    before: Stage, after: Stage, case: Case, camera: Camera, training: Sequence[Camera]
) -> tuple[Bool[Tensor, "h w"], Bool[Tensor, "h w"]]:
    """Pixels that show the thing before, and those of them whose surface after nobody saw."""
    empty = torch.zeros((camera.height, camera.width), dtype=torch.bool)
    if case.task != "removal":
        return empty, empty
    hole = before.mask(camera, case.subject)
    traced = after.scene.trace(camera)
    asked = hole & traced.hit
    points = camera.unproject(camera.pixel_centers()[asked], traced.depth[asked])
    seen = torch.zeros(len(points), dtype=torch.bool)
    for each in training:
        seen |= before.scene.visible(points, each)
    unseen = empty.clone()
    unseen[asked] = ~seen
    return hole, unseen


def _write_views(
    folder: Path, cameras: Sequence[Camera], pictures: Sequence[Float[Tensor, "h w 3"]]
) -> None:
    for i, picture in enumerate(pictures):
        save_picture(as_picture(picture), folder / _name(i), overwrite=True)
    views = tuple(Viewpoint(_name(i), camera) for i, camera in enumerate(cameras))
    write_view_list(ViewList(views, ("held_out",) * len(views)), folder / CAMERAS, overwrite=True)


def _cameras(folder: Path) -> tuple[Camera, ...]:
    return tuple(each.camera for each in read_view_list(folder / CAMERAS).viewpoints)


def _name(index: int) -> str:
    return f"{index:03d}.png"
