"""`gsedit make`: from photos or a video to an edited scene."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from shlex import quote
from time import monotonic
from typing import Annotated, Any

from gsedit.capture.settings import CaptureSettings
from gsedit.errors import InputError, UsageError

from ..core.command import Seeded, Setting, Settings, Values, settings_of, shows
from ..core.console import print_message, print_result
from ..core.exits import Interrupted
from ..core.outputs import check_folder
from ..options.cameras import ViewOptions
from ..options.common import Folder
from ..options.editors import EditorOptions, read_sentence
from .capture import Source, capture_summary, run_capture, settings_from
from .edit import EditCommand, EditOptions, Instruction, run_edit
from .fit import FitOptions, Recipe, run_fit

RECORD = "make.json"
"""File in the folder with the request and the result of each stage."""
POSING = ("frames", "lens", "focal")
"""Settings of a capture that have an option here; `gsedit capture` has all."""


def posing_settings() -> list[Setting]:
    """An option for each of POSING."""
    others = tuple(each.name for each in fields(CaptureSettings) if each.name not in POSING)
    return list(settings_of(CaptureSettings(), without=others))


@shows(
    "--output", "--size", "--quality", "--minutes", "--frames", "--lens", "--focal", "--editor",
    "--model", "--force", "--seed",
)  # fmt: skip
def make(
    photos: Source,
    instruction: Instruction,
    *,
    own: Folder,
    posing: Annotated[Values, Settings(posing_settings)],
    recipe: Recipe,
    editor: EditorOptions,
    common: Seeded,
) -> None:
    """Make an edited scene from photos or a video, in one command.

    gsedit make photos/ "turn it into bronze" -o out

    The folder gets capture/ (posed photos), scene.ply, and edit/ (the edited scene and its
    report). PHOTOS may have poses (nerfstudio, COLMAP).

    The same command goes on after an interruption.
    """
    begun = monotonic()
    settings = settings_from(posing, common)
    work = Work(photos, instruction, own.out, settings, recipe, editor, common)
    work.check()
    stages, ledger = work.stages(), Ledger(own.out / RECORD)
    check_stages(stages, ledger, force=own.force)
    run_stages(stages, ledger)
    results = [ledger.result(stage).split("\n")[0] for stage in stages]
    print_message(work.screen(results[-3:], monotonic() - begun))
    places = {"dataset": work.dataset, "scene": work.scene, "edited": work.edit / "scene.ply"}
    print_result({"folder": own.out, **places}, str(places["edited"]))


@dataclass(frozen=True)
class Work:
    """Request of a command, and the places of its results."""

    photos: Path
    instruction: str
    out: Path
    posing: CaptureSettings
    recipe: Recipe
    editor: EditorOptions
    common: Seeded

    @property
    def dataset(self) -> Path:
        """Return the folder of the posed photos."""
        return self.photos if has_poses(self.photos) else self.out / "capture"

    @property
    def scene(self) -> Path:
        return self.out / "scene.ply"

    @property
    def edit(self) -> Path:
        """The folder of the edit."""
        return self.out / "edit"

    def check(self) -> None:
        """Raise UsageError or InputError for what can be known before the long work: photos that
        are not there, an instruction that the editor cannot follow."""
        from gsedit.capture.capture import check_frames, check_places

        if not self.instruction.strip():
            raise UsageError("the instruction is empty: say what should change: 'make it snow'")
        if os.path.realpath(self.photos) == os.path.realpath(self.out):
            raise UsageError(f"-o {self.out} is where the photos are: choose another folder")
        if has_poses(self.photos):
            self.check_no_posing()
        else:
            check_places(self.photos, self.out / "capture")
            check_frames(self.photos, self.posing)
        from gsedit.editing.plan import is_exact

        for step in read_sentence(self.instruction, drawn=self.editor.draws_all):
            if not is_exact(step):
                self.editor.make(self.edit, step)

    def check_no_posing(self) -> None:
        """Raise UsageError where photos that have poses are to be posed in some way."""
        usual = CaptureSettings()
        given = [
            f"--{name}" for name in POSING if getattr(self.posing, name) != getattr(usual, name)
        ]
        if given:
            raise UsageError(
                f"{self.photos} has poses already, and {' and '.join(given)} would change nothing: "
                "leave that out, or name a folder of the photos alone to pose them anew"
            )

    def stages(self) -> list[Stage]:
        """The stages in order. Photos that have poses are not captured."""
        from gsedit.run.json_lines import plain

        asked: dict[str, Any] = {"photos": state_of(self.photos, self.out)}
        asked["seed"] = self.common.seed
        stages = []
        if not has_poses(self.photos):
            asked |= {name: getattr(self.posing, name) for name in POSING}
            what, last = "where each photo was taken from", self.dataset / "capture.json"
            stages.append(Stage("capture", what, dict(asked), last, self.capture_photos))
        asked |= {"size": self.recipe.pixels(), "quality": self.recipe.quality}
        asked["minutes"] = self.recipe.minutes
        stages.append(Stage("fit", "the scene", dict(asked), self.scene, self.fit_scene))
        asked |= {"instruction": self.instruction, "editor": plain(self.editor)}
        last = self.edit / "edit.json"
        instead = f"edit the same scene into another folder: {self.another_edit()}"
        return [*stages, Stage("edit", self.instruction, asked, last, self.edit_scene, instead)]

    def another_edit(self, instruction: str = "...") -> str:
        """The command that edits the scene further."""
        data = quote(str(self.dataset))
        return f'gsedit edit {quote(str(self.scene))} "{instruction}" --data {data} -o other'

    def capture_photos(self, same: bool) -> str:
        """Its own stages know what is left of them: nothing is done again that need not be."""
        from gsedit.capture.capture import is_begun

        force = not is_begun(self.dataset)
        result = run_capture(self.photos, self.dataset, self.posing, force=force)
        print_message(summary := capture_summary(result))
        return summary

    def fit_scene(self, same: bool) -> str:
        own = FitOptions(out=self.scene, force=True, resume=same)
        settings = self.recipe.settings({})
        result = run_fit(self.dataset, own, self.recipe.pixels(), settings, self.common)
        assert result is not None  # there is one rank
        summary = f"{len(result.scene):,} Gaussians, {result.psnr:.1f} dB on held-out photos"
        print_message(f"{summary}; look: gsedit view {quote(str(self.scene))}")
        return summary

    def edit_scene(self, same: bool) -> str:
        views = ViewOptions(data=self.dataset, size=self.recipe.pixels())
        own = EditOptions(out=self.edit, force=True, resume=same)
        request = self.scene, self.instruction, self.edit, own, views, self.editor, {}, self.common
        run_edit(EditCommand(*request, sized=self.recipe.size is not None))
        return self.instruction

    def screen(self, results: list[str], seconds: float) -> str:
        """Return the places of the results and the next commands; `results` are the stages'."""
        scene, edit = quote(str(self.scene)), quote(str(self.edit))
        places = [self.dataset, self.scene, self.edit / "scene.ply"][-len(results) :]
        width = max(len(str(place)) for place in places)
        lines = [f"{place!s:<{width}}  {result}" for place, result in zip(places, results)]
        lines += [
            f"look:    {self.edit / 'before_after.png'}",
            f"report:  {self.edit / 'edit.json'}",
            f"next:    gsedit view {scene} {edit}/scene.ply",
            f"         gsedit render {edit}/scene.ply --path turntable -o turn.mp4",
            f"         {self.another_edit('make it snow')}",
        ]
        return "\n".join([f"done in {seconds:.0f} s", *lines])


def has_poses(photos: Path) -> bool:
    """Whether it is a dataset that a fit reads as it is."""
    from gsedit.views.colmap import model_folder

    if photos.is_dir():
        return (photos / "transforms.json").is_file() or model_folder(photos) is not None
    return photos.suffix.lower() == ".json" and photos.is_file()


def state_of(photos: Path, out: Path) -> str:
    """The place of photos or a video, and a fingerprint of the paths, sizes and times of its files.

    Hidden files do not count: file managers leave them. Nor does what is in `out`, a folder inside.
    Raises InputError for a folder without photos.
    """
    from gsedit.capture.folder import find_photos
    from gsedit.capture.photos import state_of as states
    from gsedit.capture.stages import fingerprint

    place, out = Path(os.path.realpath(photos)), Path(os.path.realpath(out))
    files: Iterable[Path] = [place]
    if place.is_dir() and has_poses(place):
        inside = place in out.parents
        files = sorted(
            each
            for each in place.rglob("*")
            if each.is_file()
            and not (inside and out in each.parents)
            and not any(part[0] == "." for part in each.relative_to(place).parts)
        )
    elif place.is_dir():
        files = find_photos(place, out).files
    return f"{place} {fingerprint(states(list(files)))}"


OTHER_FOLDER = "name another folder with -o"


@dataclass(frozen=True)
class Stage:
    """One verb's part of the work."""

    name: str
    what: str
    """Description of the stage for a person."""
    asked: Mapping[str, Any]
    """Request that decides the result, with those of the stages before; as JSON holds it."""
    last: Path
    """The file that is written last."""
    work: Callable[[bool], str] = field(compare=False)
    """Run the stage, given whether to resume it; returns a line about the result."""
    instead: str = ""
    """Alternative for an error message where the folder holds another result."""


class Ledger:
    """File with the request and the result of each stage of a folder."""

    def __init__(self, path: Path) -> None:
        """Raises InputError for a damaged file."""
        from gsedit.run.json_files import read_json

        self.path = path
        self.entries: dict[str, dict[str, Any]] = {}
        try:
            if path.is_file():
                self.entries = {
                    name: {"asked": entry["asked"], "result": entry["result"]}
                    for name, entry in read_json(path).items()
                }
        except (InputError, KeyError, TypeError, AttributeError):
            raise InputError(
                f"{path} is damaged: remove it, and add -f to do all stages again"
            ) from None

    def is_begun(self, stage: Stage) -> bool:
        """Whether the stage was begun, asked for the same, and did not end."""
        return self.is_same(stage) and not self.ended(stage)

    def is_done(self, stage: Stage) -> bool:
        return self.is_same(stage) and self.ended(stage) and stage.last.is_file()

    def ended(self, stage: Stage) -> bool:
        """Whether there is a result, of this request or another."""
        return stage.name in self.entries and self.entries[stage.name]["result"] is not None

    def is_same(self, stage: Stage) -> bool:
        """Whether the stage was asked for the same."""
        return stage.name in self.entries and not self.changes(stage)

    def result(self, stage: Stage) -> str:
        """The line about its result."""
        return self.entries[stage.name]["result"]

    def changes(self, stage: Stage) -> tuple[str, ...]:
        """Return the names of the parts of the request that have changed."""
        before, now = self.entries.get(stage.name, {}).get("asked"), dict(stage.asked)
        if before is None:
            return ()
        return tuple(key for key in {**before, **now} if before.get(key) != now.get(key))

    def keep(self, stage: Stage, result: str | None) -> None:
        """Write that the stage was begun (None), or what it came to."""
        from gsedit.run.json_lines import write_record

        names = [*self.entries, stage.name]
        for follows in names[names.index(stage.name) + 1 :]:  # from what is no longer there
            self.entries.pop(follows, None)
        self.entries[stage.name] = {"asked": stage.asked, "result": result}
        write_record(self.entries, self.path, overwrite=True)


def check_stages(stages: Sequence[Stage], ledger: Ledger, *, force: bool) -> None:
    """Raise UsageError, before any work, where the folder holds something else: files that are not
    of these stages, or stages that ended and were asked otherwise; unless `force`."""
    folder = ledger.path.parent
    check_folder(folder, force or bool(ledger.entries))
    for stage in stages:
        changed = ledger.changes(stage)
        if changed and ledger.ended(stage) and not force:
            raise UsageError(
                f"{folder} holds the {stage.name} of another request (other {', '.join(changed)}): "
                f"add -f to replace it and what follows from it, or {stage.instead or OTHER_FOLDER}"
            )


def run_stages(stages: Sequence[Stage], ledger: Ledger) -> None:
    """Do the stages that are not done, with a line each. Raises Interrupted with what to do next,
    and whatever a stage raises."""
    redone = False
    for number, stage in enumerate(stages, 1):
        heading = f"{number} of {len(stages)}, {stage.name}"
        if ledger.is_done(stage) and not redone:
            print_message(f"{heading}: done before ({stage.last})")
            continue
        print_message(f"{heading}: {stage.what}")
        same = ledger.is_begun(stage)
        redone = True
        ledger.keep(stage, None)
        try:
            ledger.keep(stage, stage.work(same))
        except (Interrupted, KeyboardInterrupt):
            raise Interrupted(
                f"interrupted in the {stage.name}; what is done is kept in {ledger.path.parent}: "
                "the same command continues there"
            ) from None
