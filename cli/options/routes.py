"""Edits by exact routes: when a sentence takes them, and the folder that they write."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from gsedit.errors import UsageError

from ..core.console import print_message, print_result
from ..core.kernel import say_kernel
from ..core.ranks import is_first
from .cameras import ViewOptions, resolve_cameras
from .editing import AUTO, EditorOptions
from .settings import Values, with_values

if TYPE_CHECKING:
    from gsedit.datasets.viewpoints import Viewpoint
    from gsedit.editing.routes.apply import Routed
    from gsedit.editing.routes.folder import Compared
    from gsedit.regions.region import Region
    from gsedit.words.instruction import Instruction
    from rasterizer.numerics import Execution
    from rasterizer.scene import Gaussians

SHOWN_VIEWS = 4
"""Held-out views of before_after.png, at which the edit is measured."""
SETTINGS = ("region", "execution")
"""Settings that exact routes heed; any other one asks for the 2D editor."""


def heeds_routes(editor: EditorOptions, values: Values) -> bool:
    """Return whether exact routes may be taken: no option asks for the 2D editor."""
    return editor == EditorOptions() and all(path[0] in SETTINGS for path in values)


def exact_instruction(text: str, editor: EditorOptions, values: Values) -> Instruction | None:
    """Return the instruction if exact routes can do all of it, and no option asks for an editor.

    Raises UsageError for a sentence that is refused.
    """
    if not heeds_routes(editor, values):
        return None
    from gsedit.editing.routes.apply import is_exact
    from gsedit.words.direct import UNCLEAR
    from gsedit.words.read import read_instruction

    instruction = read_instruction(text)
    if not instruction.known:
        raise UsageError(instruction.why)
    if unclear := next((c.name for c in instruction.changes if c.name in UNCLEAR), None):
        raise UsageError(
            f"{text!r}: what small makes of a {unclear} is hardly seen to be one: --editor small "
            "draws it anyway, --editor pix2pix --model FOLDER follows any sentence"
        )
    return instruction if is_exact(instruction) else None


@dataclass(frozen=True, eq=False)
class Prepared:
    """A scene that is read, and the views in which routes look at it."""

    scene: Gaussians
    viewpoints: tuple[Viewpoint, ...]
    region: str
    execution: Execution

    @property
    def find(self) -> Callable[[Gaussians], Region]:
        """The search for the part that changes."""
        from gsedit.editing.routes.subject import find_part

        return partial(
            find_part, viewpoints=self.viewpoints, region=self.region, execution=self.execution
        )

    def asked(self, instruction: Instruction) -> Instruction:
        """Return the instruction, in the part that --region names if it is given."""
        return only_in_region(instruction) if self.region != AUTO else instruction


def prepare(
    scene: Path, load: Callable[[], Gaussians], views: ViewOptions, values: Values
) -> Prepared:
    """Read the scene, and find its views."""
    from gsedit.cameras.around import FOUND_VIEWS
    from gsedit.datasets.viewpoints import same_size
    from gsedit.editing.session.settings import EditSettings

    settings = with_values(EditSettings(), values)
    gaussians = load()
    say_kernel(settings.execution)
    resolved = resolve_cameras(scene, gaussians, views, FOUND_VIEWS, settings.execution)
    viewpoints = same_size(resolved.viewpoints, views.size)
    return Prepared(gaussians, viewpoints, settings.region, settings.execution)


def run_routes(
    scene: Path,
    load: Callable[[], Gaussians],
    instruction: Instruction,
    folder: Path,
    views: ViewOptions,
    values: Values,
    *,
    as_json: bool,
    is_last: bool = True,
) -> None:
    """Edit a scene by exact routes and write the folder. Raises UsageError as `apply_change`.

    The place of the result is printed unless another edit follows.
    """
    if not is_first():
        return
    from gsedit.editing.routes.apply import apply_instruction
    from gsedit.editing.routes.folder import compare
    from gsedit.runs.stopwatch import Stopwatch

    watch = Stopwatch()
    with watch.stage("read"):
        gaussians = load()  # bad input is told in one line: nothing is printed before
        print_message(f"understood as: {instruction}; done on the Gaussians, no view is edited")
        ready = prepare(scene, lambda: gaussians, views, values)
    with watch.stage("change"):
        cameras = [viewpoint.camera for viewpoint in ready.viewpoints]
        asked, execution = ready.asked(instruction), ready.execution
        routed = apply_instruction(ready.scene, asked, ready.find, cameras, execution)
    for note in routed.notes:
        print_message(note)
    with watch.stage("measure"):
        compared = compare(ready.scene, routed, shown(ready.viewpoints), execution)
    timings = {**watch.stages, "total": watch.seconds}
    write_folder(scene, folder, instruction, routed, compared, ready.viewpoints, views, timings)
    if is_last:
        print_routed(folder, compared, timings, as_json=as_json)


def only_in_region(instruction: Instruction) -> Instruction:
    """Return the instruction with every change in the part that is found, as `--region` says."""
    changes = tuple(replace(change, target="subject") for change in instruction.changes)
    return replace(instruction, changes=changes)


def shown(viewpoints: Sequence[Viewpoint]) -> tuple[Viewpoint, ...]:
    """Return some of the views that an edit holds out."""
    from gsedit.datasets.dataset import evenly_spaced
    from gsedit.datasets.view_list_files import HELD_OUT_EVERY

    held_out = viewpoints[::HELD_OUT_EVERY]
    return tuple(held_out[i] for i in evenly_spaced(len(held_out), SHOWN_VIEWS))


def write_folder(
    scene: Path,
    folder: Path,
    instruction: Instruction,
    routed: Routed,
    compared: Compared,
    viewpoints: Sequence[Viewpoint],
    views: ViewOptions,
    timings: dict[str, float],
) -> None:
    """Write the scene, its pictures and cameras, and last the record."""
    from gsedit.datasets.cameras_json import write_cameras
    from gsedit.datasets.view_list_files import by_edit, write_view_list
    from gsedit.editing.routes.folder import write_routed
    from gsedit.editing.session.folder import history_of

    request = {"scene": scene, **asdict(views), "editor": {"editor": AUTO}, **history_of(scene)}
    folder.mkdir(parents=True, exist_ok=True)
    write_cameras(viewpoints, folder / "cameras.json", overwrite=True)
    write_view_list(by_edit(viewpoints, ()), folder / "views.json", overwrite=True)
    write_routed(folder, instruction, routed, compared, timings=timings, request=request)


def print_routed(
    folder: Path, compared: Compared, timings: dict[str, float], *, as_json: bool
) -> None:
    """Print what was measured and where the edited scene is."""
    outside = compared.psnr_outside
    kept = "" if outside is None else f"; outside the region {outside:.1f} dB to the unedited scene"
    print_message(f"changed by {compared.changed:.3f} RMSE{kept}; {timings['total']:.1f} s")
    print_message(
        f"results are in {folder}; look at {folder / 'before_after.png'}, then: "
        f"gsedit view {folder / 'scene.ply'}"
    )
    record = {
        "folder": folder,
        "scene": folder / "scene.ply",
        "ground_truth": None,
        "psnr_outside_region": outside,
    }
    print_result(record, str(folder / "scene.ply"), as_json=as_json)
