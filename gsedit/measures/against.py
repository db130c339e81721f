"""Reading of `--against`: the unedited scene, the folder of an edit, photos, or pictures."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

from gsedit.errors import InputError
from gsedit.formats.edit_records import read_edit_record
from gsedit.formats.pictures import fitted_size
from gsedit.measures.agreement import Pictures
from gsedit.measures.metrics import GIVEN, NO_TARGETS
from gsedit.run.inputs import existing_file
from gsedit.run.json_files import object_of, read_json
from gsedit.views import view_list_files as view_lists
from gsedit.views.colmap import model_folder
from gsedit.views.view_list_files import ViewList
from gsedit.views.view_pictures import SUFFIXES, NoPicturesError, read_view_pictures

Kind = Literal["scene", "edit", "photos", "pictures"]
TARGETS, HELD_OUT, ALONE = "targets", "held_out", "held_out_alone"
"""Folders of pictures in the folder of an edit: what the scene was fitted to, and what the 2D
editor makes of held-out views, tied to the targets and alone."""
TARGETS_ARE = ("the edits that the scene was fitted to", "edits tied to the targets by anchors")
"""The source of an edit's pictures, of edited and of held-out views."""
UNFINISHED = "metrics.unfinished.jsonl"
"""File of the events so far, in the folder of an edit that has no result yet."""


@dataclass(frozen=True)
class Reference:
    """Reference that a scene is compared with."""

    kind: Kind
    path: Path
    unedited: Path | None = None
    """The file of the unedited scene."""
    drop_invalid: bool = False
    """Whether rows of that file with NaN or infinity are left out, as the edit left them out."""
    region: Path | None = None
    """Flags of the unedited scene's Gaussians: where the edit belongs."""
    edited_region: Path | None = None
    """Flags of the edited scene's Gaussians, where an edit removed, moved or added objects."""
    pictures: tuple[Path, ...] = ()
    """Folders of pictures that the scene should show."""
    alone: Path | None = None
    """Folder of edited pictures of held-out views that were made without the targets."""
    views: ViewList | None = None
    """The views of an edit."""
    cost: Mapping[str, float] = field(default_factory=dict)
    """Cost of the edit, by the names of gsedit.measures.metrics.COST."""

    @property
    def why_no_pictures(self) -> str:
        """Why a scene has no pictures to be compared with here, and what to do."""
        if self.kind == "edit":
            return f"{self.path} has none: an earlier version made it, or it edits no views"
        return NO_TARGETS

    @property
    def why_no_cost(self) -> str:
        """Why it does not say what an edit took, and what to do."""
        if self.kind == "edit":
            return f"{self.path / 'edit.json'} does not say it: run the edit again"
        return "only the folder of an edit says it: add --against with that folder"

    @property
    def fitted(self) -> str:
        """Name of the scene's views that are not held out, for a person."""
        return "fitted" if self.kind == "photos" else "edited"

    @property
    def pictures_are(self) -> tuple[str, str]:
        """The source of its pictures, of fitted and of held-out views, for a record."""
        if self.kind == "edit":
            return TARGETS_ARE
        return ("photos", "photos") if self.kind == "photos" else GIVEN

    @property
    def targets(self) -> str:
        """Name of its pictures, for a person."""
        return {"edit": "edited views", "photos": "photos"}.get(self.kind, "pictures")


def resolve_reference(path: str | Path) -> Reference:
    """Reference at a path, as far as it is told without reading scenes and pictures.

    Raises InputError where nothing is there that a scene can be compared with.
    """
    path = Path(path)
    if path.is_dir() and (path / "edit.json").is_file():
        return _edit(path)
    if (path / "transforms.json").is_file() or (path.is_dir() and model_folder(path)):
        return Reference("photos", path)
    if path.is_dir():
        if (path / UNFINISHED).is_file():
            raise InputError(
                f"{path} is the folder of an edit that did not finish (no edit.json in it): finish "
                "it with gsedit edit first"
            )
        if any(file.suffix.lower() in SUFFIXES for file in path.rglob("*")):
            return Reference("pictures", path, pictures=(path,))
        raise InputError(
            f"{path} is no folder of an edit (edit.json), of photos (transforms.json, COLMAP) or "
            "of pictures: check the path"
        )
    if path.suffix.lower() == ".json":
        if read_json(path, object_of({})).get("format") == view_lists.FORMAT:
            raise InputError(f"{path} is a list of views: give it with --views")
        return Reference("photos", path)
    return Reference("scene", existing_file(path), unedited=path)


def find_pictures(against: Reference, views: ViewList) -> Pictures:
    """Its pictures, by the index of the view; those of an edit where the list has such views.

    Raises InputError as `read_view_pictures` does.
    """
    found: dict[int, Any] = {}
    for folder in against.pictures:
        try:
            found |= read_view_pictures(folder, views.viewpoints)
        except NoPicturesError:
            if against.kind != "edit":
                raise
    return found


def find_alone(against: Reference, views: ViewList) -> Pictures:
    """The pictures of an edit that were made without its targets, by the index of the view."""
    if against.alone is None:
        return {}
    with suppress(NoPicturesError):  # of another list of views
        return read_view_pictures(against.alone, views.viewpoints)
    return {}


def resized(views: ViewList, size: int | None) -> ViewList:
    """Resize views so that the longer side has at most `size` pixels (None: as they are)."""
    viewpoints = []
    for viewpoint in views.viewpoints:
        camera = viewpoint.camera
        width, height = fitted_size(camera.width, camera.height, size)
        viewpoints.append(replace(viewpoint, camera=camera.resized(width, height)))
    return replace(views, viewpoints=tuple(viewpoints))


def _edit(folder: Path) -> Reference:
    """The folder that `gsedit edit` wrote. Raises InputError, with the file and the next move."""
    file = folder / "edit.json"
    record = read_edit_record(file)
    region, before = folder / "region.npy", folder / "region_before.npy"
    moved = before.is_file()
    folders, listed = (folder / TARGETS, folder / HELD_OUT), folder / view_lists.NAME
    return Reference(
        "edit",
        folder,
        unedited=_unedited(record.get("scene"), folder),
        drop_invalid=bool(record.get("drop_invalid")),
        region=before if moved else region if region.is_file() else None,
        edited_region=region if moved and region.is_file() else None,
        pictures=tuple(each for each in folders if each.is_dir() and any(each.rglob("*.png"))),
        alone=folder / ALONE if any((folder / ALONE).rglob("*.png")) else None,
        views=view_lists.read_view_list(listed) if listed.is_file() else None,
        cost=_cost(record),
    )


def _unedited(named: Any, folder: Path) -> Path:
    """The file that edit.json names: from here, or from a folder above the edit's."""
    if not isinstance(named, str):
        raise InputError(
            f"{folder / 'edit.json'} does not name the unedited scene: compare with that scene "
            f"itself: --against SCENE --region {folder / 'region.npy'}"
        )
    places = [Path(named), *(above / named for above in folder.absolute().parents)]
    try:
        found = next((place for place in places if place.is_file()), None)
    except OSError:  # too long a name
        found = None
    if found is None:
        raise InputError(
            f"{folder / 'edit.json'} names the unedited scene {named}, which is not there: run "
            "this where the edit was run, or compare with the scene itself: --against SCENE "
            f"--views {folder / view_lists.NAME} --region {folder / 'region.npy'}"
        )
    return found


def _cost(record: Mapping[str, Any]) -> dict[str, float]:
    """Wall clock and network evaluations, those of them that edit.json says."""
    places = {"seconds": ("timings", "total"), "evaluations": ("work", "network_evaluations")}
    cost = {}
    for name, (group, key) in places.items():
        value = record.get(group, {}).get(key)
        if isinstance(value, int | float) and not isinstance(value, bool):
            cost[name] = value
    return cost
