"""Photos or a video into a folder of posed photos, in stages (`stages.py`)."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from gsedit.capture.causes import Evidence, before_features, cause, hopeless, listed
from gsedit.capture.exif import FULL_FRAME_DIAGONAL, groups_of
from gsedit.capture.folder import Found, counted, find_photos
from gsedit.capture.frames import Extraction, extract_steps, is_video
from gsedit.capture.photos import HEIC, Prepared, prepare, state_of
from gsedit.capture.settings import (
    FEWEST,
    MOST_PAIRS,
    Attempt,
    CaptureSettings,
    Pair,
    choose,
    ladder,
    ranked,
)
from gsedit.capture.stages import (
    LOG,
    Line,
    Stages,
    Step,
    Working,
    copy_database,
    fingerprint,
    remove,
    rows,
)
from gsedit.capture.upright import find_upright
from gsedit.errors import GseditError, InputError, UsageError
from gsedit.run.atomic import atomic_path
from gsedit.run.events import Event
from gsedit.run.json_files import read_json

WORK = "work"
"""The folder of the stages."""
RESULTS = ("capture.json", "capture.png", "cameras.json", "images", "sparse")
ENOUGH_SHARE = 0.8
"""Share of the photos: with fewer posed, other settings are tried."""
LEAST_SHARE = 0.25
"""Share of the photos: with fewer posed there is no scene to speak of."""


@dataclass(frozen=True)
class CaptureResult:
    """Result of a capture, as in capture.json."""

    folder: str
    photos: int
    """Number of usable photos."""
    posed: int
    islands: tuple[int, ...]
    """Photos of each model, the largest first: the first is the scene."""
    error: float
    """Mean reprojection error, pixels."""
    points: int
    focals: tuple[tuple[float, str], ...]
    """Focal length of each camera in 35 mm equivalents, and its source."""
    upright: str
    """Source of the upright frame: "gravity" or "the cameras"."""
    missing: tuple[str, ...]
    """Photos without a pose."""
    unreadable: tuple[str, ...]
    seconds: float


Progress: TypeAlias = Iterator[Event | Line | CaptureResult]


def check_places(source: Path, out: Path) -> None:
    """Raise InputError where `source` does not exist, UsageError where the work would remove it."""
    if not source.exists():
        raise InputError(f"{source} does not exist: name a folder of photos or a video")
    if source.is_file() and not is_video(source):
        raise InputError(f"{source} is neither a folder of photos nor a video: name one")
    place = Path(os.path.realpath(source))  # no error for a loop of links, unlike Path.resolve
    removed = [Path(os.path.realpath(out / name)) for name in (WORK, *RESULTS)]
    if place == Path(os.path.realpath(out)) or any(
        each in (place, *place.parents) for each in removed
    ):
        what = f"the photos in {source}" if source.is_dir() else str(source)
        raise UsageError(f"-o {out} would replace {what}: choose another folder")


def check_frames(source: Path, settings: CaptureSettings) -> None:
    """Raise UsageError where a number of frames is asked of a folder of photos."""
    if settings.frames is not None and source.is_dir():
        raise UsageError(
            f"--frames {settings.frames} is for a video, and {source} is a folder of photos, of "
            "which all are used: leave --frames out"
        )


def is_begun(out: Path) -> bool:
    """Whether a folder holds the stages of a capture."""
    return (out / WORK / LOG).is_file()


def start_anew(out: Path) -> None:
    """Remove what an earlier capture left in a folder.

    Raises UsageError, and removes nothing, where the folder has folders of those names that no
    capture made.
    """
    if not is_begun(out) and not (out / "capture.json").is_file():
        others = [name for name in (WORK, *RESULTS) if (out / name).is_dir()]
        if others:
            raise UsageError(
                f"-o {out} holds {listed(others)}, which no capture made, and -f would remove it: "
                "choose another folder"
            )
    for name in (*RESULTS, WORK):
        remove(out / name)


def capture_steps(source: Path, out: Path, settings: CaptureSettings) -> Progress:
    """Pose the photos of a folder, or the frames of a video; yields events, lines, then the result.

    Writes into the folder `out`: images/ (undistorted), sparse/0 (COLMAP's binary format),
    cameras.json, capture.json, capture.png, and work/ (the stages). World: y down, in no known
    unit. Raises InputError, with the cause and the next move, where the photos cannot be posed.
    """
    found = find_photos(source, out) if source.is_dir() else None
    stages = Stages(out / WORK, settings.threads)
    found = found or (yield from _frames(source, stages, settings))
    for note in found.notes:
        yield Line(note)
    prepared, key = yield from _prepared(found, source, stages, settings)
    if fault := before_features(prepared, source):
        raise InputError(fault)
    if prepared.unreadable:
        yield Line(_left_out(prepared.unreadable))
    work = _Mapping(source, stages, settings, prepared, key)
    yield from work.climb()
    count, posed = len(prepared.photos), work.posed
    if not work.is_usable:
        raise InputError(
            f"{source}: {posed or 'none'} of {count} photos could be posed: " + work.cause()
        )
    result = yield from _finish(work, out)
    if result.missing:
        number = len(result.missing)
        lost = f"{number} photo{'s have' if number > 1 else ' has'} no pose"
        yield Line(f"{lost} ({listed(result.missing)}): {work.cause()}")
    stages.clean()
    yield result


def _frames(source: Path, stages: Stages, settings: CaptureSettings) -> Working:
    """The frames of a video."""
    key = fingerprint(state_of([source]), settings.frames)
    answer, folder = stages.answer("frames", key), stages.place(f"frames-{key}")
    if not answer.exists():
        remove(folder)
        folder.mkdir()
        for item in extract_steps(source, folder, settings.frames):
            if isinstance(item, Extraction):
                names = [path.name for path in item.paths]
                stages.keep("frames", key, {"names": names, "notes": item.notes})
            else:
                yield replace(item, seconds=stages.seconds)
    record = read_json(answer, advice="remove it")
    return Found(tuple(folder / name for name in record["names"]), tuple(record["notes"]))


def _prepared(found: Found, source: Path, stages: Stages, settings: CaptureSettings) -> Working:
    """The prepared photos, and the key of their stage."""
    key = fingerprint(state_of(found.files), settings.size)
    answer, folder = stages.answer("photos", key), stages.place(f"photos-{key}")
    if not answer.exists():
        remove(folder)
        for item in prepare(found.files, folder, settings.size, source):
            if isinstance(item, Prepared):
                stages.keep("photos", key, asdict(item))
            else:
                yield stages.event("photos", item.step, item.steps)
    return Prepared.load(answer), key


def _left_out(unreadable: Sequence[str]) -> str:
    some = f"{len(unreadable)} files are" if len(unreadable) > 1 else "1 file is"
    move = f"; {HEIC}" if any("(HEIC)" in each for each in unreadable) else ""
    return f"{some} no usable photo: {listed(unreadable)}; going on with the rest{move}"


class _Mapping:
    """Features, matches and mapping of prepared photos: the attempts, and the best of them."""

    def __init__(
        self, source: Path, stages: Stages, settings: CaptureSettings, prepared: Prepared, key: str
    ) -> None:
        self.source = source
        self.stages, self.settings, self.prepared, self.key = stages, settings, prepared, key
        self.images = stages.folder / f"photos-{key}"
        self.groups = groups_of(prepared.photos, settings)
        self.evidence: Evidence | None = None
        """Of the last attempt."""
        self.models: list[dict[str, Any]] = []
        """Of the best attempt, the largest first."""
        self.database = Path()
        self.best = ""
        """The key of the best attempt."""

    @property
    def posed(self) -> int:
        return len(self.models[0]["poses"]) if self.models else 0

    @property
    def is_usable(self) -> bool:
        """Whether the best attempt posed enough photos to speak of a scene."""
        return self.posed >= max(FEWEST, LEAST_SHARE * len(self.prepared.photos))

    def cause(self) -> str:
        """Why not all photos have a pose."""
        assert self.evidence is not None
        return cause(self.evidence, len(self.prepared.photos), self.posed)

    def climb(self) -> Working:
        """The attempts of the ladder, until enough photos have a pose or nothing can help."""
        count = len(self.prepared.photos)
        for name, attempt in ladder(self.settings):
            if name:
                if self.posed >= ENOUGH_SHARE * count:
                    return
                posed = self.posed or "none"
                yield Line(
                    f"{posed} of {count} photos posed: trying again with {name}",
                    "--no-retries: not",
                )
            before = self.evidence
            if fault := (yield from self._try(attempt)):
                if not self.is_usable:
                    raise InputError(f"{self.source}: {fault}")
                self.evidence = before
                yield Line(f"now it looks as if {fault}; going on with what was posed before")
                return

    def _try(self, attempt: Attempt) -> Working:
        """Match the chosen pairs and map, then the other pairs of photos without a pose, as long as
        there are any; why these photos cannot be posed, whatever is tried."""
        names = [photo.name for photo in self.prepared.photos]
        database, key = yield from self._features(attempt)
        request = {"database": str(database), "names": names}
        common = (yield from self.stages.run("pairs", key, request))["common"]
        pairs, order, of_features, verified = choose(common), ranked(common), key, -1
        while True:
            database, key = yield from self._match(database, of_features, pairs, attempt)
            assert self.evidence is not None
            fault, posed = hopeless(self.evidence), {}
            if verified == (verified := len(self.evidence.pairs)):
                return fault
            if not fault:
                models, key = yield from self._map(database, key)
                posed = models[0]["poses"] if models else {}
                if len(posed) > self.posed:
                    self.models, self.database, self.best = models, database, key
            left = [name not in posed for name in names]
            more = {*[(i, j) for i, j in order if left[i] or left[j]][:MOST_PAIRS]} - pairs
            if not more:
                return fault
            yield Line(
                f"{counted(sum(left), 'photo')} without a pose: matching {len(more)} more pairs"
            )
            pairs |= more

    def _features(self, attempt: Attempt) -> Working:
        """The database of features, and the key of their stage."""
        photos, settings, stages = self.prepared.photos, self.settings, self.stages
        asked = {
            "groups": [group.request(settings.lens) for group in self.groups],
            "features": attempt.features, "peak": attempt.peak, "affine": attempt.affine,
            "size": settings.size,
        }  # fmt: skip
        key = fingerprint(self.key, asked)
        features = stages.place(f"features-{key}.db")
        request = {"database": str(features), "images": str(self.images), **asked}
        look = lambda: Step(rows(features, "keypoints"), len(photos))  # noqa: E731
        yield from stages.run("features", key, request, look=look)
        return features, key

    def _match(self, source: Path, key: str, pairs: set[Pair], attempt: Attempt) -> Working:
        """The database of `source` with the matches of pairs, and the key of their stage."""
        photos, settings, stages = self.prepared.photos, self.settings, self.stages
        compared = sorted(pairs)
        key = fingerprint(key, compared, attempt.affine, settings.seed)
        database = stages.place(f"matches-{key}.db")
        listing = stages.place(f"matches-{key}.txt")
        lines = (f"{photos[i].name} {photos[j].name}\n" for i, j in compared)
        listing.write_text("".join(lines), encoding="utf-8")
        if not database.exists():  # else an interrupted run goes on in it
            copy_database(source, database)
        request = {
            "database": str(database), "pairs": str(listing), "guided": attempt.affine,
            "seed": settings.seed,
        }  # fmt: skip
        note = f"of {len(photos) * (len(photos) - 1) // 2} pairs"
        look = lambda: Step(rows(database, "two_view_geometries"), len(compared), note)  # noqa: E731
        found = yield from stages.run("matches", key, request, look=look)
        known = all(group.focal is not None for group in self.groups)
        self.evidence = Evidence(found["features"], found["pairs"], known)
        return database, key

    def _map(self, database: Path, key: str) -> Working:
        """The models of an attempt, the largest first, and the key of their stage."""
        asked = {"count": len(self.prepared.photos), "seed": self.settings.seed}
        key = fingerprint(key, "incremental mapping", asked)
        folder = self.stages.place(f"models-{key}")
        if not self.stages.answer("mapping", key).exists():
            remove(folder)
        places = {"database": database, "images": self.images, "output": folder}
        request = {**{name: str(path) for name, path in places.items()}, **asked}
        answer = yield from self.stages.run("mapping", key, request)
        order = sorted(
            answer["models"], key=lambda model: (len(model["poses"]), model["points"]), reverse=True
        )
        return [{**model, "folder": folder / model["folder"]} for model in order], key

    def refine(self) -> Working:
        """The largest model, refined: its answer, its folder, and the key of the stage."""
        key = fingerprint(self.best, "principal points, more points, a photo of each camera")
        folder = self.stages.place(f"refined-{key}")
        places = {
            "model": self.models[0]["folder"], "database": self.database, "images": self.images,
            "output": folder,
        }  # fmt: skip
        request = {**{name: str(path) for name, path in places.items()}, "seed": self.settings.seed}
        answer = yield from self.stages.run("refinement", key, request)
        return answer, folder, key

    def focals(self, cameras: Sequence[dict[str, Any]]) -> tuple[tuple[float, str], ...]:
        """Focal length of each camera in 35 mm equivalents, and its source."""
        focals = []
        for each in cameras:
            diagonal = np.hypot(each["width"], each["height"])
            equivalent = float(each["focal"] / diagonal * FULL_FRAME_DIAGONAL)
            source = next(group.source for group in self.groups if each["photo"] in group.names)
            focals.append((round(equivalent, 1), source))
        return tuple(focals)


def _finish(work: _Mapping, out: Path) -> Working:
    """Refine, turn upright and undistort the largest model; the result, which is written too."""
    model, refined, key = yield from work.refine()
    names = sorted(model["poses"])
    gravity = {name: each for group in work.groups for name, each in group.gravities.items()}
    turn, upright = find_upright(
        np.array([[*model["poses"][name], [0, 0, 0, 1]] for name in names], dtype=np.float64),
        np.array([gravity.get(name) or (np.nan,) * 3 for name in names], dtype=np.float64),
    )
    rotation = turn.tolist()
    yield from _undistort(work, refined, rotation, fingerprint(key, rotation), len(names), out)
    photos = work.prepared.photos
    result = CaptureResult(
        folder=str(out),
        photos=len(photos),
        posed=len(names),
        islands=tuple(len(each["poses"]) for each in work.models),
        error=model["error"],
        points=model["points"],
        focals=work.focals(model["cameras"]),
        upright=upright,
        missing=tuple(photo.name for photo in photos if photo.name not in model["poses"]),
        unreadable=work.prepared.unreadable,
        seconds=work.stages.seconds,
    )
    with atomic_path(out / "capture.json", overwrite=True) as temporary:
        temporary.write_text(json.dumps(asdict(result), indent=1))
    return result


def _undistort(
    work: _Mapping, model: Path, rotation: list[list[float]], key: str, count: int, out: Path
) -> Working:
    """images/ and sparse/0 of the result, and what shows them: whole, or as they were."""
    stages = work.stages
    undistorted, done = stages.answer("undistortion", key), stages.answer("results", key)
    if not all((out / name).exists() for name in ("images", "sparse", "cameras.json")):
        done.unlink(missing_ok=True)
    if done.exists():
        yield stages.event("undistortion", 1, 1, "done before")
        return
    place = stages.folder / "undistorted"
    remove(undistorted)
    remove(place)
    place.mkdir()
    request = {
        "model": str(model), "images": str(work.images), "output": str(place), "rotation": rotation,
        "size": work.settings.size,
    }  # fmt: skip
    look = lambda: Step(len(list(place.glob("images/*"))), count)  # noqa: E731
    yield from stages.run("undistortion", key, request, look=look)
    for each in (*stages.folder.glob("results-*.json"), *(out / name for name in RESULTS)):
        remove(each)
    for name in ("sparse", "images"):
        (place / name).rename(out / name)
    remove(place)
    yield stages.event("picture")
    if fault := describe(out):
        yield Line(fault)
    stages.keep("results", key, {})
    yield stages.event("picture", 1, 1)


def describe(out: Path) -> str:
    """Write cameras.json and capture.png of a folder, as `fit` reads it; why not, if a picture
    cannot be drawn."""
    from gsedit.capture.picture import save_picture
    from gsedit.views.cameras_json import write_cameras
    from gsedit.views.colmap import read_colmap
    from gsedit.views.viewpoints import Viewpoint

    found = read_colmap(out / "sparse" / "0")
    cameras = [photo.lens.camera(photo.world_to_camera) for photo in found.photos]
    views = [Viewpoint(photo.name, camera) for photo, camera in zip(found.photos, cameras)]
    write_cameras(views, out / "cameras.json", overwrite=True)
    if found.points is None or found.points.rgb is None:
        return ""
    xyz, rgb = found.points.xyz.numpy(), found.points.rgb.numpy()
    try:
        save_picture(xyz, rgb, cameras, out / "capture.png")
    except GseditError as error:
        return f"{out / 'capture.png'} is not drawn: {error}"
    return ""
