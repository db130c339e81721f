"""Work that one and two ranks must compute alike: `python rank_worker.py FILE` saves it."""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from functools import lru_cache

import torch

from gsedit import Dataset, EditSettings, FitSettings, edit_steps, fit_steps
from gsedit.bench.synthetic import demo_scene, surface_gaussians
from gsedit.capture.fitting.settings import UpdateSettings
from gsedit.errors import GseditError
from gsedit.paper.diffusion.settings import SamplerSettings
from gsedit.paper.editors import Capabilities, EditProgress
from gsedit.paper.editors.closed_form import ClosedForm, Perturbation
from gsedit.paper.editors.sampling import DiffusionEditor
from gsedit.paper.strategies.single_pass import SinglePass
from gsedit.run.ranks import Ranks, join
from gsedit.views.dataset import capture
from gsedit.views.orbit import circle

SIZE = 32


def generator() -> torch.Generator:
    return torch.Generator().manual_seed(3)


@lru_cache(maxsize=1)
def captured():
    """The demo scene, and pictures of it from 9 sides."""
    solid = demo_scene()
    scene = surface_gaussians(solid, 600, torch.Generator().manual_seed(1))
    middle = torch.zeros(3, dtype=torch.float64)
    cameras = circle(middle, 0.7, solid.up, 9, SIZE, elevation=20.0, fov=45.0)
    views = capture(scene, cameras, [f"view_{i}" for i in range(9)])
    return scene, Dataset(views, scene.means[:200].double())


@dataclass(frozen=True, eq=False)
class Network(ClosedForm):
    """A denoiser that declares a network, and so has its views shared out: it draws nothing."""

    perturbation: Perturbation = field(default_factory=lambda: Perturbation(0.0, 0.0, 0.0))

    @property
    def capabilities(self) -> Capabilities:
        return Capabilities(with_micro_batch=lambda views: self)

    def condition(self, originals, prompt, generator):
        return super().condition(originals, prompt, torch.Generator())


@dataclass(frozen=True, eq=False)
class Networked(DiffusionEditor):
    """Its editor, whose cost nobody measures: several ranks would not."""

    @property
    def capabilities(self) -> Capabilities:
        shared = super().capabilities.with_ranks
        return Capabilities(with_micro_batch=lambda views: self.denoiser, with_ranks=shared)


@dataclass(frozen=True)
class Spray:
    """An editor of another package: it draws random numbers, and says nothing of ranks."""

    name: str = "spray"
    cell: int = 8
    capabilities: Capabilities = field(default_factory=Capabilities)

    def check(self, prompt):
        return None

    def edit(self, batch, settings, generator):
        noise = torch.rand(batch.images.shape, generator=generator)
        yield EditProgress(1, 2)
        yield EditProgress(2, 2, torch.lerp(batch.images, noise, 0.3))


def run_edit(ranks: Ranks, editor, views: int, rounds: int = 1):
    """A second round of 3 views is tied to the first by anchors; a rank has 2 or 1 of the views."""
    settings = EditSettings(
        sampler=SamplerSettings(steps=2, precision="float32"),
        update=UpdateSettings(patches=3, patch=16),
        views_per_batch=views,
        batches=rounds,
        coverage=1.0,
        region="all",
        held_out_edits=1,
    )
    scene, data = captured()
    *_, result = edit_steps(
        scene, "as gold", editor=editor, generator=generator(), views=data,
        settings=settings, strategy=SinglePass(6), ranks=ranks,
    )  # fmt: skip
    return {
        "sh": result.scene.sh,
        "opacities": result.scene.logit_opacities,
        "targets": torch.stack([view.image for view in result.targets]),
        "finals": torch.stack([view.image for view in result.finals]),
        "work": [result.work.calls, result.work.evaluations, result.work.steps],
        "losses": [event.loss for event in result.events if event.loss is not None],
    }


def run_fit(ranks: Ranks):
    """Steps of 3 photos: 2 on one rank and 1 on the other."""
    settings = FitSettings(
        steps=16,
        seconds=None,
        dense_start=60,
        batch=3,
        densify_every=6,
        sh_degree=0,
        evaluations=1,
        coarse=(),
    )
    *events, result = fit_steps(captured()[1], settings, generator=generator(), ranks=ranks)
    losses = [event.loss for event in events if getattr(event, "loss", None) is not None]
    return {
        "means": result.scene.means, "sh": result.scene.sh, "psnr": result.psnr,
        "steps": result.steps, "losses": losses,
    }  # fmt: skip


def run_primitives(ranks: Ranks):
    """Values that every rank receives of the others."""
    x = torch.arange(10.0).reshape(5, 2)
    total = torch.full((2,), float(ranks.rank + 1))
    ranks.add_up([total])
    try:
        ranks.check_same("the number", [ranks.rank])
        differs = ""
    except GseditError as error:
        differs = str(error)
    return {
        "rows": ranks.rows(lambda rows: rows + 1, x),
        "one": ranks.rows(lambda rows: rows.sum(1), x[:1]),
        "none": ranks.rows(lambda rows: rows + 1, x[:0]),
        "sum": total,
        "first": ranks.first({"rank": ranks.rank, "x": x + ranks.rank}),
        "differs": differs,
    }


def everything(ranks: Ranks):
    return {
        "primitives": run_primitives(ranks),
        "edit": run_edit(ranks, Networked(Network()), views=3, rounds=2),
        "one view": run_edit(ranks, Networked(Network()), views=1),
        "spray": run_edit(ranks, Spray(), views=2),
        "fit": run_fit(ranks),
    }


if __name__ == "__main__":
    torch.set_num_threads(1)
    here = join()
    torch.save(everything(here), f"{sys.argv[1]}.{here.rank}")
    here.leave()
