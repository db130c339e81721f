"""The request of an edit: everything that is given, checked, with every default filled in."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, is_dataclass, replace
from functools import partial
from itertools import chain
from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor

from gsedit.capture.fitting.update import check_installed
from gsedit.errors import UsageError
from gsedit.measures.features import MIN_SIDE, FeatureExtractor, FilterBank
from gsedit.paper.editors.protocol import Editor, StylePainter
from gsedit.paper.settings import EditSettings
from gsedit.run.json_lines import plain
from gsedit.run.state import digest_of
from gsedit.select.region import Region
from gsedit.views.dataset import Dataset, View
from gsedit.views.lazy_views import of_one_size
from gsedit.views.viewpoints import Viewpoint, Views, same_size, that_see, thinned, viewpoints_of
from rasterizer.camera import Camera
from rasterizer.render import render_picture
from rasterizer.scene import Gaussians


def check_strategy(strategy: Any) -> None:
    """Raise UsageError for what is no strategy."""
    if isinstance(strategy, type) or not is_dataclass(strategy):
        raise UsageError(
            f"{strategy!r} is no strategy: give an instance of a dataclass, as in SinglePass()"
        )


def fits_pictures(strategy: Any) -> bool:
    """Whether it fits the scene to edited pictures alone; others render the optimizer's scene."""
    return getattr(strategy, "fits_pictures", True)


def uses_all_views(strategy: Any) -> bool:
    """Whether it edits or renders views that are not in the plan."""
    return getattr(strategy, "dataset_views", "planned") == "all"


def name_of(strategy: Any) -> str:
    """The name of a strategy, as on the command line."""
    return type(strategy).__module__.rpartition(".")[2].replace("_", "-")


RESUME_IGNORED = ("checkpoint_seconds", "execution", "held_out_edits")
"""Settings that may change when an edit is resumed: they do not change the scene."""


@dataclass(frozen=True, eq=False)
class Method:
    """How a 2D editor's pictures come into a scene."""

    editor: Editor
    strategy: Any
    """The order of edited views and fits, see gsedit.paper.actions.Strategy."""
    generator: torch.Generator
    features: FeatureExtractor | None = None
    """Features that the Gram loss compares; None: a bank of oriented filters."""


@dataclass(frozen=True, eq=False)
class Request:
    """An edit as it was asked for: scene, instruction, settings, editor, and views."""

    scene: Gaussians
    prompt: str
    views: tuple[View, ...]
    """Views that may be edited; indices elsewhere are into `every_view`, which begins with them."""
    held_out: tuple[View, ...]
    """Views that are only measured at."""
    editor: Editor
    settings: EditSettings
    strategy: Any
    """The strategy, see gsedit.paper.actions.Strategy."""
    features: FeatureExtractor
    """Features that the Gram loss compares."""
    generator: torch.Generator
    region: Region | None = None
    """The Gaussians of `scene` that may change; None: the edited views will tell."""
    seen: Float[Tensor, "v n"] | None = None
    """How much each of `views` sees of each Gaussian; None: a survey will tell."""
    leading: Int[Tensor, " n"] | None = None
    """The one of `views` that each Gaussian follows, -1 for none; None: no strokes are kept, or a
    survey will tell."""
    whole: Gaussians | None = None
    """The scene of which `scene` holds the groups; None: it is itself whole."""

    @property
    def solves(self) -> bool:
        """Whether the colors that fit the edited pictures are solved for."""
        return self.settings.solves and fits_pictures(self.strategy)

    @property
    def keeps_strokes(self) -> bool:
        """Whether the scene is fitted to the strokes of a view where that leads, see
        gsedit.capture.fitting.strokes."""
        paints, camera = isinstance(self.editor, StylePainter), self.every_view[0].camera
        tiny = min(camera.width, camera.height) < MIN_SIDE  # the features of strokes see nothing
        return self.solves and paints and not tiny and self.settings.update.strokes > 0

    @property
    def rules(self) -> tuple[str, ...]:
        """Rules by which the editor draws, for which it is told places."""
        return self.editor.rules if isinstance(self.editor, StylePainter) else ()

    @property
    def every_view(self) -> tuple[View, ...]:
        """The views that may be edited, then the held-out ones."""
        return (*self.views, *self.held_out)

    @property
    def held_out_indices(self) -> tuple[int, ...]:
        """Indices of the held-out views."""
        return tuple(range(len(self.views), len(self.every_view)))


def build_request(
    scene: Gaussians,
    prompt: str,
    views: Views,
    region: Region | None,
    settings: EditSettings,
    method: Method,
) -> Request:
    """The request of an edit; the editor follows the prompt. Raises UsageError without views."""
    strategy, scene = method.strategy, scene.detach()
    check_installed(settings.update)
    editor = method.editor
    size = _edit_size(settings, editor)
    drawn = size if isinstance(editor, StylePainter) and settings.condition != "photo" else None
    some, held_out = of_one_size(_pictures(views, scene, drawn)).split()
    if not some:  # a single view, which would be held out, may be edited
        some, held_out = held_out, ()
    settings = _with_defaults(settings, editor, some[0].camera, size)
    return Request(
        scene, prompt, some, held_out, editor, settings, strategy,
        method.features or FilterBank(), method.generator, region,
    )  # fmt: skip


def _pictures(views: Views, scene: Gaussians, drawn: int | None) -> Dataset:
    """Views with pictures: photos, or renders that are made when they are read. Of many cameras
    every k-th is taken, and those that see nothing of the scene are left out; smaller ones are
    made `drawn` pixels long, so that strokes come into the scene as they are drawn."""
    if isinstance(views, Dataset) and not drawn:
        return views
    seeing = that_see(thinned(viewpoints_of(views)), scene)
    if not seeing:
        raise UsageError("no camera sees any of the scene: they may not be in the same frame")
    if drawn and drawn > max(seeing[0].camera.width, seeing[0].camera.height):
        seeing = same_size(seeing, drawn)

    def view(each: Viewpoint) -> View:
        render: Any = partial(render_picture, scene, each.camera)
        return View(each.name, each.camera, render, None, None, each.lens)

    return Dataset(tuple(map(view, seeing)))


def _edit_size(settings: EditSettings, editor: Editor) -> int | None:
    """Longer side of the pictures that the editor is given, as asked for or as it edits best."""
    best = editor.capabilities.best_size
    if settings.edit_size or not best or not isinstance(editor, StylePainter):
        return settings.edit_size or best
    return round(best / settings.brush)


def _with_defaults(
    settings: EditSettings, editor: Editor, camera: Camera, size: int | None
) -> EditSettings:
    """The settings in force, which the result records: the editor's defaults are filled in.

    Views of this camera's size are edited larger where the editor enlarges, but photos never.
    """
    declared, batches = editor.capabilities, settings.batches
    if isinstance(editor, StylePainter) and batches is None:
        batches = editor.stroke_batches
    keeps = settings.condition == "photo" or not declared.enlarges
    if size and keeps and size >= camera.longest:
        size = None  # the views' own
    sampler = settings.sampler.with_defaults(declared.defaults)
    return replace(settings, sampler=sampler, edit_size=size, batches=batches)


def request_record(request: Request) -> dict[str, Any]:
    """The request as JSON has it: an edit may be resumed where this is the same."""
    fields = (getattr(request.scene, name) for name in request.scene.__dataclass_fields__)
    settings = plain(request.settings)
    record = {
        "scene": f"{len(request.scene)} Gaussians, {digest_of(fields)}",
        "instruction": request.prompt,
        "settings": {k: value for k, value in settings.items() if k not in RESUME_IGNORED},
        "strategy": {"name": name_of(request.strategy), **plain(request.strategy)},
        "editor": request.editor.name,
        "views": _described(request.every_view, request.settings.condition),
        "seed": request.generator.initial_seed(),
    }
    return plain(record)


def _described(views: Sequence[View], condition: str) -> str:
    """Number, size and digest of the views' cameras; of the pictures too where they count."""
    cameras = [view.camera for view in views]
    poses = torch.stack([camera.world_to_camera.double() for camera in cameras])
    lenses = torch.tensor([[c.fx, c.fy, c.cx, c.cy] for c in cameras], dtype=torch.float64)
    levels = ((255 * view.image).round().byte() for view in views if condition == "photo")
    # a found camera may differ by rounding
    rounded = [each.round(decimals=5) for each in (poses, lenses)]
    found = digest_of(chain(rounded, levels))
    return f"{len(views)} of {cameras[0].width}x{cameras[0].height}, {found}"
