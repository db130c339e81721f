"""Edit a scene from a sentence: each change by the route that does it, or all by a 2D editor."""

from __future__ import annotations

from collections import deque
from typing import Any

import torch

from gsedit.cameras.around import find_viewpoints
from gsedit.datasets.dataset import Dataset
from gsedit.datasets.viewpoints import viewpoints_of
from gsedit.editing.edit import edit_steps
from gsedit.editing.routes.apply import is_exact
from gsedit.editing.routes.plan import asks_editor_2d, steps_of
from gsedit.editing.routes.result import routed_result
from gsedit.editing.session.actions import Strategy
from gsedit.editing.session.result import EditResult
from gsedit.editing.session.settings import EditSettings
from gsedit.editor_protocol import Editor
from gsedit.editors import make_editor
from gsedit.errors import UsageError
from gsedit.measures.features import FeatureExtractor
from gsedit.select.finder import Names
from gsedit.select.provider import MaskProvider
from gsedit.words.read import read_instruction
from rasterizer.scene import Gaussians


def edit(
    scene: Gaussians,
    prompt: str,
    *,
    editor: Editor | None = None,
    dataset: Dataset | None = None,
    settings: EditSettings | None = None,
    strategy: Strategy | None = None,
    features: FeatureExtractor | None = None,
    generator: torch.Generator | None = None,
    masks: MaskProvider | None = None,
) -> EditResult:
    """Edit a scene from a sentence, to the end.

    The sentence is read (gsedit.words) and each change goes by its own route; the editor `small`
    draws what no route does. Where they take turns, the result is that of the last one. With an
    editor, a strategy, features, or a setting other than `region` and `execution`, the 2D editor
    (`small` if none is given) draws all of it: see `edit_steps`.
    `masks` finds what sentences name ("the chair", see `gsedit.editors.make_masks`); without it a
    noun alone is the subject. Raises UsageError for a sentence that is refused, and for masks where
    the 2D editor draws all of it.
    """
    request: dict[str, Any] = {"dataset": dataset, "settings": settings, "features": features}
    request["generator"] = generator or torch.Generator().manual_seed(0)
    if editor or strategy or features or (settings and asks_editor_2d(settings)):
        _refuse_masks(masks)
        return _drawn(scene, prompt, editor=editor, strategy=strategy, **request)
    steps, result = steps_of(read_instruction(prompt)), None
    if not any(map(is_exact, steps)):
        _refuse_masks(masks)
    for step in steps:
        now = scene if result is None else result.scene
        if is_exact(step):
            viewpoints = viewpoints_of(dataset) if dataset else find_viewpoints(now)
            result = routed_result(now, step, viewpoints, settings, names=Names(masks=masks))
        else:
            result = _drawn(now, step.text, **request)
    assert result is not None  # a known instruction has changes
    return result


def _refuse_masks(masks: MaskProvider | None) -> None:
    if masks is not None:
        raise UsageError(
            "masks find what is changed on the Gaussians, and a 2D editor draws this: save what "
            "gsedit.select.masked.find_masked finds, and name it by settings.region"
        )


def _drawn(
    scene: Gaussians, prompt: str, *, editor: Editor | None = None, **request: Any
) -> EditResult:
    """Edit by a 2D editor, `small` if none is given."""
    steps = edit_steps(scene, prompt, editor=editor or make_editor(), **request)
    last = deque(steps, maxlen=1).pop()  # checkpoints are whole scenes: none is kept
    assert isinstance(last, EditResult)
    return last
