"""The request of an edit: everything that is given, checked, with every default filled in."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import Any

import torch

from gsedit.cameras.around import around
from gsedit.datasets.dataset import Dataset, View, evenly_spaced
from gsedit.datasets.lazy_views import of_one_size
from gsedit.editing.session.settings import EditSettings
from gsedit.editing.session.strategy import asks_editor, check_strategy, fits_pictures, name_of
from gsedit.editor_protocol import Editor
from gsedit.editors.ranked import with_ranks
from gsedit.errors import UsageError
from gsedit.fitting.edit_loss import check_installed
from gsedit.measures.features import FeatureExtractor, FilterBank
from gsedit.runs.json_lines import plain
from gsedit.runs.ranks import ALONE, Ranks
from gsedit.runs.state import digest, digest_of
from gsedit.scene.merging.groups import MergedScene, coarsen
from rasterizer.camera import Camera
from rasterizer.scene import Gaussians

RESUME_IGNORED = ("checkpoint_seconds", "execution", "held_out_edits")
"""Settings that may change when an edit is resumed: they do not change the scene."""
CAMERA_DECIMALS = 5
"""Decimals of a camera's numbers that identify it: a found one may differ by rounding."""
LARGE_HELD_OUT_VIEWS = 4
"""Held-out views at which the edit of a large scene is measured: each render takes seconds."""


@dataclass(frozen=True, eq=False)
class Request:
    """An edit as it was asked for: scene, instruction, settings, editor, and views."""

    scene: Gaussians
    """The Gaussians that are fitted: of a large scene, the merged ones."""
    prompt: str
    views: tuple[View, ...]
    """Views that may be edited; indices elsewhere are into `every_view`, which begins with them."""
    held_out: tuple[View, ...]
    """Views that are only measured at."""
    editor: Editor
    settings: EditSettings
    strategy: Any
    """The strategy, see gsedit.editing.session.actions.Strategy."""
    features: FeatureExtractor
    """Features that the Gram loss compares."""
    generator: torch.Generator
    coarse: MergedScene | None = None
    """The merged scene of a large one, and that itself; None for others."""
    ranks: Ranks = ALONE
    """Processes among which the work is shared; each has the whole request."""

    @property
    def whole(self) -> Gaussians:
        """The scene that pictures show, with all Gaussians of a large one."""
        return self.scene if self.coarse is None else self.coarse.fine

    @property
    def solves(self) -> bool:
        """Whether the colors that fit the edited pictures are solved for."""
        return self.settings.solves and fits_pictures(self.strategy)

    @property
    def every_view(self) -> tuple[View, ...]:
        """The views that may be edited, then the held-out ones."""
        return (*self.views, *self.held_out)

    @property
    def held_out_indices(self) -> tuple[int, ...]:
        """Indices of the held-out views."""
        return tuple(range(len(self.views), len(self.every_view)))

    @property
    def evaluation_views(self) -> tuple[int, ...]:
        """Indices of the held-out views at which the result is measured: a few of a large scene."""
        indices = self.held_out_indices
        number = len(indices) if self.coarse is None else LARGE_HELD_OUT_VIEWS
        return tuple(indices[i] for i in evenly_spaced(len(indices), number))


def build_request(
    scene: Gaussians,
    prompt: str,
    editor: Editor,
    generator: torch.Generator,
    strategy: Any,
    *,
    dataset: Dataset | None = None,
    settings: EditSettings | None = None,
    features: FeatureExtractor | None = None,
    ranks: Ranks = ALONE,
) -> Request:
    """The request of an edit; without a dataset, views are found (`around`).

    Raises UsageError for an instruction the editor cannot follow, an empty scene, or a strategy
    that is no dataclass.
    """
    settings, editor = settings or EditSettings(), with_ranks(editor, ranks)
    check_strategy(strategy)
    if asks_editor(strategy):
        editor.check(prompt)
    elif settings.region == "auto" and not _follows(editor, prompt):
        settings = replace(settings, region="all")  # nobody can say where it belongs
    if not len(scene):
        raise UsageError("the scene is empty: there is nothing to edit")
    check_installed(settings.update)
    views, held_out = split_views(dataset or around(scene, execution=settings.execution))
    settings = _with_defaults(settings, editor, (views or held_out)[0].camera)
    cameras = [view.camera for view in (*views, *held_out)]
    coarse = _merged(scene.detach(), settings, strategy, cameras)
    return Request(
        coarse.scene if coarse else scene.detach(), prompt, views, held_out, editor, settings,
        strategy, features or FilterBank(), generator, coarse, ranks,
    )  # fmt: skip


def split_views(dataset: Dataset) -> tuple[tuple[View, ...], tuple[View, ...]]:
    """The views that may be edited and the held-out ones, all of one size.

    A single view, which would be held out, may be edited.
    """
    views, held_out = of_one_size(dataset).split()
    return (views, held_out) if views else (held_out, ())


def _follows(editor: Editor, prompt: str) -> bool:
    """Whether the editor could follow the instruction."""
    try:
        editor.check(prompt)
    except UsageError:
        return False
    return True


def _with_defaults(settings: EditSettings, editor: Editor, camera: Camera) -> EditSettings:
    """The settings in force, which the result records: the editor's defaults are filled in.

    Views of this camera's size are edited larger where the editor enlarges, but photos never.
    """
    declared = editor.capabilities
    size = settings.edit_size or declared.best_size
    keeps = settings.condition == "photo" or not declared.enlarges
    if size and keeps and size >= max(camera.width, camera.height):
        size = None  # the views' own
    sampler = settings.sampler.with_defaults(declared.defaults)
    return replace(settings, sampler=sampler, edit_size=size)


def _merged(
    scene: Gaussians, settings: EditSettings, strategy: Any, cameras: Sequence[Camera]
) -> MergedScene | None:
    """The merged scene that a large one is edited by; None where its Gaussians are edited."""
    is_merged = settings.geometry == "appearance" and settings.skips("merging")
    return coarsen(scene, cameras=cameras) if is_merged and fits_pictures(strategy) else None


def request_record(request: Request) -> dict[str, Any]:
    """The request as JSON has it: an edit may be resumed where this is the same."""
    fields = (getattr(request.scene, name) for name in request.scene.__dataclass_fields__)
    settings = plain(request.settings)
    record = {
        "scene": f"{len(request.scene)} Gaussians, {digest(*fields)}",
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
    rounded = [each.round(decimals=CAMERA_DECIMALS) for each in (poses, lenses)]
    found = digest_of(chain(rounded, levels))
    return f"{len(views)} of {cameras[0].width}x{cameras[0].height}, {found}"
