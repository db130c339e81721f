"""Edits of a tiny painted scene with the closed-form editor, for the laws of strategies."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import lru_cache

import torch

import gsedit
from gsedit import Checkpoint, Dataset, EditResult, Event, edit_steps
from gsedit.bench.synthetic import demo_scene, ring_cameras, surface_gaussians
from gsedit.capture.fitting.settings import UpdateSettings
from gsedit.paper.actions import Strategy
from gsedit.paper.diffusion.settings import SamplerSettings
from gsedit.paper.editors import EditBatch, EditProgress, make_editor
from gsedit.paper.editors.protocol import Editor
from gsedit.views.dataset import capture
from rasterizer import Gaussians

SETTINGS = gsedit.EditSettings(
    sampler=SamplerSettings(steps=4),
    update=UpdateSettings(patches=1, patch=32),
    views_per_batch=2,
    batches=2,
    held_out_edits=0,
)
PROMPT = "as bronze"


@lru_cache
def painted(count: int) -> Gaussians:
    return surface_gaussians(demo_scene(), count, torch.Generator().manual_seed(0))


@lru_cache
def seen(count: int, views: int, size: int) -> Dataset:
    """Pictures of `painted` from all around."""
    cameras = ring_cameras(demo_scene(), views, size)
    return Dataset(capture(painted(count), cameras, [f"{i:02d}" for i in range(views)]))


def scene() -> Gaussians:
    return painted(1000)


def data() -> Dataset:
    """Nine views: the last is held out, eight may be edited."""
    return seen(1000, 9, 48)


@dataclass(eq=False)
class Watched:
    """The closed-form editor, which notes what it is asked."""

    inner: Editor = field(default_factory=lambda: make_editor("closed-form"))
    asked: list[tuple[EditBatch, SamplerSettings]] = field(default_factory=list)

    name = property(lambda self: self.inner.name)
    cell = property(lambda self: self.inner.cell)
    capabilities = property(lambda self: self.inner.capabilities)
    check = property(lambda self: self.inner.check)

    def edit(
        self, batch: EditBatch, settings: SamplerSettings, generator: torch.Generator
    ) -> Iterator[EditProgress]:
        self.asked.append((batch, settings))
        return self.inner.edit(batch, settings, generator)


def steps(
    scene: Gaussians,
    views: Dataset | None,
    settings: gsedit.EditSettings,
    strategy: Strategy,
    editor: Editor | None = None,
    sentence: str = PROMPT,
    seed: int = 0,
) -> list[Event | Checkpoint | EditResult]:
    """All that an edit tells; the result is the last."""
    given = {"views": views, "settings": settings, "strategy": strategy}
    return list(
        edit_steps(
            scene, sentence, editor=editor or make_editor("closed-form"),
            generator=torch.Generator().manual_seed(seed), **given,
        )
    )  # fmt: skip


def run(
    strategy: Strategy, settings: gsedit.EditSettings = SETTINGS, editor: Watched | None = None
) -> tuple[EditResult, list[Event]]:
    """The result and the events of an edit."""
    *items, result = steps(scene(), data(), settings, strategy, editor or Watched())
    assert isinstance(result, EditResult)
    return result, [item for item in items if isinstance(item, Event)]
