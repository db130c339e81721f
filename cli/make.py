"""`gsedit make`: from photos or a video to an edited scene."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields
from pathlib import Path
from shlex import quote
from time import monotonic
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .cameras import ViewOptions
from .capture import Source, capture_summary, run_capture, settings_from
from .console import print_message, print_result
from .edit import Instruction, run_edit
from .edit_options import EditorOptions
from .fit import FITTING, Level, PhotoSize, Quality, run_fit, with_budget
from .options import Force, Seeded, output
from .setting_options import Layout, Setting, SettingsGroup, Values, settings_of
from .stages import Ledger, Stage, check_stages, run_stages

if TYPE_CHECKING:
    from gsedit.capture.settings import CaptureSettings
    from gsedit.fitting.settings import Quality as QualityRecord

RECORD = "make.json"
"""In the folder: what each stage was asked for, and what it came to."""
POSING = ("frames", "lens", "focal")
"""Settings of a capture that have an option here; `gsedit capture` has all."""

Minutes = Annotated[
    float | None,
    typer.Option(
        "--minutes",
        min=0.01,
        show_default="that of --quality",
        rich_help_panel=FITTING,
        help="Time for the fit.",
    ),
]


def posing_settings() -> list[Setting]:
    """An option for each of POSING."""
    from gsedit.capture.settings import CaptureSettings

    others = tuple(each.name for each in fields(CaptureSettings) if each.name not in POSING)
    return settings_of(CaptureSettings(), Layout("Posing", without=others))


def make(
    photos: Source,
    instruction: Instruction,
    out: Annotated[Path, output("Folder for the posed photos, the scene and the edit.")],
    size: PhotoSize = None,
    force: Force = False,
    *,
    posing: Annotated[Values, SettingsGroup(posing_settings)],
    quality: Quality = Level.NORMAL,
    minutes: Minutes = None,
    editor: EditorOptions,
    common: Seeded,
) -> None:
    """From photos or a video to an edited scene: capture, fit and edit in one go.

    gsedit make photos/ "turn it into bronze" -o out

    The folder gets capture/ (posed photos), scene.ply, and edit/ (the edited scene and its report).
    PHOTOS may have poses already: nerfstudio (transforms.json) or COLMAP.

    The same command goes on where it was interrupted, and repeats nothing that is done. -f replaces
    the stages that were asked for something else, and those after them.
    """
    begun = monotonic()
    settings = settings_from(posing, common)
    work = Work(
        photos, instruction, out, size or quality_of(quality).size, settings, quality, minutes,
        editor, common,
    )  # fmt: skip
    work.check()
    stages, ledger = work.stages(), Ledger(out / RECORD)
    check_stages(stages, ledger, force=force)
    run_stages(stages, ledger)
    results = [ledger.result(stage).split("\n")[0] for stage in stages]
    print_message(work.screen(results[-3:], monotonic() - begun))
    places = {"dataset": work.dataset, "scene": work.scene, "edited": work.edit / "scene.ply"}
    print_result({"folder": out, **places}, str(places["edited"]), as_json=common.json)


@dataclass(frozen=True)
class Work:
    """What was asked for, and where it goes."""

    photos: Path
    instruction: str
    out: Path
    size: int
    posing: CaptureSettings
    quality: Level
    minutes: float | None
    editor: EditorOptions
    common: Seeded

    @property
    def dataset(self) -> Path:
        """The posed photos."""
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
        from gsedit.errors import UsageError

        if not self.instruction.strip():
            raise UsageError("the instruction is empty: say what should change: 'make it snow'")
        if self.photos.resolve() == self.out.resolve():
            raise UsageError(f"-o {self.out} is where the photos are: choose another folder")
        if has_poses(self.photos):
            self.check_no_posing()
        else:
            check_places(self.photos, self.out / "capture")
            check_frames(self.photos, self.posing)
        self.editor.make(self.edit, self.instruction)

    def check_no_posing(self) -> None:
        """Raise UsageError where photos that have poses are to be posed in some way."""
        from gsedit.capture.settings import CaptureSettings
        from gsedit.errors import UsageError

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
        from gsedit.reports.json_lines import plain

        asked: dict[str, Any] = {"photos": state_of(self.photos, self.out)}
        asked["seed"] = self.common.seed
        stages = []
        if not has_poses(self.photos):
            asked |= {name: getattr(self.posing, name) for name in POSING}
            what, last = "where each photo was taken from", self.dataset / "capture.json"
            stages.append(Stage("capture", what, dict(asked), last, self.capture_photos))
        asked |= {"size": self.size, "quality": self.quality.value, "minutes": self.minutes}
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
        result = run_capture(
            self.photos, self.dataset, self.posing, force=force, as_json=self.common.json
        )
        print_message(summary := capture_summary(result))
        return summary

    def fit_scene(self, same: bool) -> str:
        settings = with_budget({}, self.minutes, quality_of(self.quality).settings)
        result = run_fit(
            self.dataset, self.scene, self.size, settings,
            force=True, resume=same, common=self.common,
        )  # fmt: skip
        assert result is not None  # there is one rank
        summary = f"{len(result.scene):,} Gaussians, {result.psnr:.1f} dB on held-out photos"
        print_message(f"{summary}; look: gsedit preview {quote(str(self.scene))}")
        return summary

    def edit_scene(self, same: bool) -> str:
        views = ViewOptions(data=self.dataset, size=self.size)
        run_edit(
            self.scene, self.instruction, self.edit, views=views, editor=self.editor,
            force=True, resume=same, common=self.common,
        )  # fmt: skip
        return self.instruction

    def screen(self, results: list[str], seconds: float) -> str:
        """What is where, and what can be done next. `results`: of the stages."""
        scene, edit = quote(str(self.scene)), quote(str(self.edit))
        places = [self.dataset, self.scene, self.edit / "scene.ply"][-len(results) :]
        width = max(len(str(place)) for place in places)
        lines = [f"{place!s:<{width}}  {result}" for place, result in zip(places, results)]
        lines += [
            f"look:    {self.edit / 'before_after.png'}",
            f"report:  {self.edit / 'edit.json'}, {self.edit / 'error_vs_time.png'}",
            f"next:    gsedit view {scene} {edit}/scene.ply",
            f"         gsedit render {edit}/scene.ply --path turntable -o turn.mp4",
            f"         {self.another_edit('make it snow')}",
        ]
        return "\n".join([f"done in {seconds:.0f} s", *lines])


def quality_of(level: Level) -> QualityRecord:
    """What a name of --quality stands for."""
    from gsedit.fitting.settings import QUALITIES

    return QUALITIES[level.value]


def has_poses(photos: Path) -> bool:
    """Whether it is a dataset that a fit reads as it is."""
    from gsedit.files.colmap import model_folder

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

    place, out = photos.resolve(), out.resolve()
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
