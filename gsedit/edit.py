"""Efficient-NeRF2NeRF on Gaussians, from a sentence to an edited scene: knows everyone."""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.consistency.correspond import Correspondences, correspond
from gsedit.diffusion import Answer, SamplerSettings, suits
from gsedit.editors.protocol import EditBatch, Editor, KnowsAnswer, advice_of
from gsedit.errors import UsageError
from gsedit.fitting import update as strategies
from gsedit.fitting.optimiser import SceneOptimiser
from gsedit.fitting.update import UpdateSettings, update_steps
from gsedit.measures import metrics
from gsedit.measures.decibels import rmse_from_psnr
from gsedit.measures.features import FeatureExtractor, FilterBank
from gsedit.reports.events import Checkpoint, Event
from gsedit.views.dataset import Dataset, View, capture
from gsedit.views.framing import bounds
from gsedit.views.orbit import orbit, orbit_names
from gsedit.views.plan import Plan, plan_views, survey
from rasterizer.camera import Camera
from rasterizer.numerics import AUTO, Execution
from rasterizer.render import Rendering, render
from rasterizer.scene import Gaussians

ORBIT_VIEWS = 24
"""Cameras placed around a scene that has none: 15 degrees apart, so that neighbours overlap."""
ORBIT_SIZE = 256
WEAK_MATCH = 0.05
"""Below this fraction of matched cells a pair of views has little to agree on: worth a warning."""
ANCHORS = 4
"""Finished views that the next batch is tied to. They cost no network call, only comparisons."""
UNSEEN = 1e-3
"""A Gaussian that shows in less than this many (survey) pixels of all edited views is not seen."""
PROBES = 3
"""Held-out views measured while the work goes on; all of them are measured at its end."""
MEASURE_EVERY = 50
REPORT_EVERY = 10


@dataclass(frozen=True)
class EditSettings:
    """Everything that decides an edit but the scene, the instruction, the editor and the seed."""

    sampler: SamplerSettings = field(default_factory=SamplerSettings)
    update: UpdateSettings = field(default_factory=UpdateSettings)
    views_per_round: int = 4
    rounds: int = 2
    coverage: float = 0.95
    """Stop after the round that covers this share of what the camera set sees."""
    geometry: Literal["appearance", "full"] = "appearance"
    condition: Literal["render", "photo"] = "render"
    """What the editor is shown as the unedited picture."""
    execution: Execution = AUTO
    """How pictures are drawn: `Execution(compile=True)` draws the same ones sooner."""

    def __post_init__(self) -> None:
        if self.views_per_round < 1 or self.rounds < 1:
            raise UsageError("views and rounds must be 1 or more")
        if not 0 < self.coverage <= 1:
            raise UsageError(f"coverage {self.coverage} is not in (0, 1]")


@dataclass(frozen=True, eq=False)
class EditResult:
    """An edited scene and its evidence: the same cameras three times."""

    scene: Gaussians
    originals: tuple[View, ...]
    targets: tuple[View, ...]
    """The edited 2D pictures that the scene was fitted to."""
    finals: tuple[View, ...]
    """Renders of the edited scene."""
    settings: EditSettings
    plan: Plan
    matched: float | None
    """Mean fraction of latent cells matched between two views of a batch; None without any two."""
    pairs: tuple[tuple[str, str, float], ...]
    """(view, view, matched fraction) of every two views that were in a batch together."""
    strength: float
    """RMSE between original and final renders: 0 is no edit at all."""
    residual: float
    """PSNR of the final renders against the 2D targets, dB."""
    answer: float | None
    """PSNR to the known answer at cameras that were never edited, dB; None if there is none."""
    timings: dict[str, float]
    """Seconds per stage."""


def edit_steps(
    scene: Gaussians,
    prompt: str,
    *,
    editor: Editor,
    generator: torch.Generator,
    dataset: Dataset | None = None,
    settings: EditSettings | None = None,
    features: FeatureExtractor | None = None,
) -> Iterator[Event | Checkpoint | EditResult]:
    """Edit a scene; yields what happens, a complete scene after every round, and last the result.

    Without a dataset, cameras are placed around the scene. Every 8th view is never edited: there
    the result is measured. Raises UsageError for an instruction the editor cannot follow, an empty
    scene, or views of different sizes.
    """
    editor.check(prompt)
    if not len(scene):
        raise UsageError("the scene is empty: there is nothing to edit")
    settings, features = settings or EditSettings(), features or FilterBank()
    sampler = settings.sampler.suited(suits(editor))
    settings = replace(settings, sampler=sampler)  # the result says what was in force
    if advice := advice_of(editor, prompt):
        yield Event("advice", 0.0, note=advice)
    views, held_out = _views(dataset or around(scene))
    work = _Work(scene.detach(), prompt, views, held_out, editor, settings, generator)
    yield from work.survey()
    for batch in work.plan.rounds:
        yield from work.edit_views(batch)
        yield from work.follow(features)
    yield from work.finish()


def edit(
    scene: Gaussians,
    prompt: str,
    *,
    editor: Editor | None = None,
    dataset: Dataset | None = None,
    settings: EditSettings | None = None,
    features: FeatureExtractor | None = None,
    generator: torch.Generator | None = None,
) -> EditResult:
    """`edit_steps` to the end, with the editor `small` if none is given."""
    from gsedit.editors import make_editor

    *_, last = edit_steps(
        scene,
        prompt,
        editor=editor or make_editor(),
        generator=generator or torch.Generator().manual_seed(0),
        dataset=dataset,
        settings=settings,
        features=features,
    )
    assert isinstance(last, EditResult)
    return last


def around(
    scene: Gaussians, size: int = ORBIT_SIZE, up: Float[Tensor, "3"] | None = None
) -> Dataset:
    """Renders of a scene that came without photos, `size` pixels square, from all around it."""
    cameras = orbit(scene, ORBIT_VIEWS, size, up=up)
    return Dataset(capture(scene.detach(), cameras, orbit_names(ORBIT_VIEWS)))


def _views(dataset: Dataset) -> tuple[tuple[View, ...], tuple[View, ...]]:
    """(views that may be edited, views that are only measured at)."""
    sizes = {(v.camera.width, v.camera.height) for v in dataset.views}
    if len(sizes) != 1:
        told = ", ".join(f"{w}x{h}" for w, h in sorted(sizes)) or "none"
        raise UsageError(f"views must have one size to be edited together, these have {told}")
    views, held_out = dataset.split()
    return (views, held_out) if views else (held_out, ())


class _Watch:
    """Seconds since the start, and per stage."""

    def __init__(self) -> None:
        self.began, self.stages = time.monotonic(), dict[str, float]()

    @property
    def seconds(self) -> float:
        return time.monotonic() - self.began

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        entered = time.monotonic()
        try:
            yield
        finally:
            self.stages[name] = self.stages.get(name, 0.0) + time.monotonic() - entered


class _Work:
    """An edit in progress: the one place with state. Indices are into `views`."""

    def __init__(
        self, scene: Gaussians, prompt: str, views: Sequence[View], held_out: Sequence[View],
        editor: Editor, settings: EditSettings, generator: torch.Generator,
    ) -> None:  # fmt: skip
        self.scene, self.prompt, self.views, self.held_out = scene, prompt, views, held_out
        self.editor, self.settings, self.generator = editor, settings, generator
        self.watch = _Watch()
        radius = bounds(scene).radius
        self.optimiser = SceneOptimiser(scene, strategies.rates(settings.geometry, radius))
        self.plan = Plan((), ())
        self.weights = torch.zeros(0)
        self.before: dict[int, Rendering] = {}
        self.unedited: list[Tensor] = []
        self.targets: dict[int, View] = {}
        self.pairs: list[tuple[str, str, float]] = []
        self.answer: Answer | None = None
        self.rounds_done = 0
        self.seed = int(torch.randint(1 << 31, (), generator=generator))

    def survey(self) -> Iterator[Event]:
        """Which views to edit, and what they and the held-out ones look like before."""
        yield Event("survey", self.watch.seconds, note=f"{len(self.views)} views")
        with self.watch.stage("survey"):
            s = self.settings
            self.weights = survey(self.scene, [v.camera for v in self.views], s.execution)
            if not self.weights.any():
                raise UsageError(
                    "no camera sees any of the scene: are both in the same frame? "
                    "Leave out --data to have cameras placed around the scene"
                )
            self.plan = plan_views(self.weights, s.views_per_round, s.rounds, s.coverage)
            before = [self._render(self.scene, self.views[i].camera) for i in self.plan.views]
            self.before = dict(zip(self.plan.views, before))
            unedited = (self._render(self.scene, v.camera) for v in self.held_out)
            self.unedited = [rendering.color.clamp(0, 1) for rendering in unedited]
        count = len(self.views)
        note = f"{len(self.plan.views)} cover {self.plan.coverage[-1]:.0%} of what all views see"
        yield Event("survey", self.watch.seconds, count, count, note=note)

    def edit_views(self, batch: Sequence[int]) -> Iterator[Event]:
        """Edit a batch of views consistently, tied to the finished ones by anchors."""
        members = (*batch, *_anchors(self.weights, batch, self.targets))
        with self.watch.stage("correspond"):
            found = self._correspondences(members)
        self.pairs += _named_pairs(found, [self.views[i].name for i in members])
        rounds = len(self.plan.rounds)
        yield Event("correspond", self.watch.seconds, self.rounds_done + 1, rounds,
                    note=_told(found))  # fmt: skip
        images = None
        with self.watch.stage("sample"):
            request = self._request(members, found if self.settings.sampler.consensus else None)
            for progress in self.editor.edit(request, self.settings.sampler, self.generator):
                yield Event("sample", self.watch.seconds, progress.step, progress.steps)
                images = progress.images
        if images is None:
            raise RuntimeError(f"editor {self.editor.name} ended without images")
        for i, image in zip(members, images):
            target = replace(self.views[i], image=image.to(self.scene.means))
            self.targets.setdefault(i, target)
        if isinstance(self.editor, KnowsAnswer):
            edited = torch.stack([view.image for view in self.targets.values()])
            originals = torch.stack([self._original(i) for i in self.targets])
            self.answer = self.editor.answer(self.prompt, edited, originals)

    def follow(self, features: FeatureExtractor) -> Iterator[Event | Checkpoint]:
        """Fit the scene to all views edited so far."""
        update = self.settings.update
        done, total = self.rounds_done * update.steps, len(self.plan.rounds) * update.steps
        with self.watch.stage("update"):
            targets = tuple(self.targets.values())
            seen = self.weights[list(self.targets)].sum(0) > UNSEEN
            losses = update_steps(
                self.optimiser,
                targets,
                seen,
                update,
                features,
                self.generator,
                self.settings.execution,
            )
            for step, loss in enumerate(losses, start=done + 1):
                if step % MEASURE_EVERY == 0:
                    psnr, aim = self.measure(PROBES)
                    yield Event("update", self.watch.seconds, step, total, loss,
                                rmse_from_psnr(psnr), f"{psnr:.2f} dB to the {aim}")  # fmt: skip
                elif step % REPORT_EVERY == 0:
                    yield Event("update", self.watch.seconds, step, total, loss)
        self.rounds_done += 1
        yield Checkpoint(self.optimiser.scene.detach(), done + update.steps, self.watch.seconds)

    def finish(self) -> Iterator[Event | EditResult]:
        """Measure the edited scene and hand everything over."""
        edited = self.optimiser.scene.detach().map(torch.clone)
        targets = tuple(self.targets.values())
        with self.watch.stage("measure"):
            cameras, names = [t.camera for t in targets], [t.name for t in targets]
            finals = capture(edited, cameras, names, self.settings.execution)
            psnr, aim = self.measure(len(self.held_out))
        originals = tuple(
            replace(self.views[i], image=self.before[i].color.clamp(0, 1)) for i in self.targets
        )
        yield Event("measure", self.watch.seconds, error=rmse_from_psnr(psnr),
                    note=f"{psnr:.2f} dB to the {aim}")  # fmt: skip
        yield EditResult(
            scene=edited,
            originals=originals,
            targets=targets,
            finals=finals,
            settings=self.settings,
            plan=self.plan,
            matched=_mean([f for *_, f in self.pairs]) if self.pairs else None,
            pairs=tuple(self.pairs),
            strength=_mean(
                metrics.edit_strength(a.image, b.image) for a, b in zip(originals, finals)
            ),
            residual=_mean(metrics.psnr(a.image, b.image) for a, b in zip(finals, targets)),
            answer=psnr if self.answer is not None and self.held_out else None,
            timings=self.watch.stages | {"total": self.watch.seconds},
        )

    def measure(self, probes: int) -> tuple[float, str]:
        """PSNR to the known answer where nothing was edited, or else to the edited pictures."""
        if self.answer is not None and self.held_out:
            shown = self.held_out[:probes]
            name = f"known answer at {len(shown)} held-out cameras"
            aims = [self.answer(picture[None])[0] for picture in self.unedited[:probes]]
        else:
            shown, name = tuple(self.targets.values()), "edited pictures"
            aims = [view.image for view in shown]
        scene = self.optimiser.scene.detach()
        pictures = [self._render(scene, view.camera).color.clamp(0, 1) for view in shown]
        return _mean(metrics.psnr(a, b) for a, b in zip(pictures, aims)), name

    def _correspondences(self, members: Sequence[int]) -> Correspondences:
        cell = self.editor.cell
        depths = [self.before[i].median_depth for i in members]
        alphas = [self.before[i].alpha for i in members]
        return correspond(
            [_whole_cells(self.views[i].camera, cell) for i in members],
            _padded(torch.stack([d for d in depths if d is not None]), cell),
            _padded(torch.stack(alphas), cell),
            cell=cell,
        )

    @torch.no_grad()
    def _render(self, scene: Gaussians, camera: Camera) -> Rendering:
        return render(scene, camera, median_depth=True, execution=self.settings.execution)

    def _original(self, i: int) -> Float[Tensor, "h w 3"]:
        """What the editor sees as the unedited picture."""
        rendered = self.before[i].color
        picture = self.views[i].image if self.settings.condition == "photo" else rendered
        return picture.clamp(0, 1).to(rendered)

    def _request(self, members: Sequence[int], found: Correspondences | None) -> EditBatch:
        """Current renders of the new views, and the anchors as they were edited."""
        scene = self.optimiser.scene.detach()
        images = [
            self.targets[i].image
            if i in self.targets
            else self._render(scene, self.views[i].camera).color.clamp(0, 1)
            for i in members
        ]
        return EditBatch(
            images=torch.stack(images),
            originals=torch.stack([self._original(i) for i in members]),
            prompt=self.prompt,
            correspondences=found,
            anchored=torch.tensor([i in self.targets for i in members]),
            seed=self.seed,
        )


def _whole_cells(camera: Camera, cell: int) -> Camera:
    """The camera with a picture that goes on to the right and below to whole cells."""
    return replace(
        camera,
        width=camera.width + -camera.width % cell,
        height=camera.height + -camera.height % cell,
    )


def _padded(maps: Float[Tensor, "v h w"], cell: int) -> Float[Tensor, "v H W"]:
    """Nothing (0) to the right and below, as far as whole cells go."""
    return torch.nn.functional.pad(maps, (0, -maps.shape[2] % cell, 0, -maps.shape[1] % cell))


def _anchors(
    weights: Float[Tensor, "v n"], batch: Sequence[int], targets: dict[int, View]
) -> tuple[int, ...]:
    """The finished views that see most of what the new ones see: they tie the rounds together."""
    shared = weights[list(batch)].sum(0)
    common = {i: float(torch.minimum(weights[i], shared).sum()) for i in targets}
    return tuple(sorted(common, key=lambda i: -common[i])[:ANCHORS])


def _named_pairs(found: Correspondences, names: Sequence[str]) -> list[tuple[str, str, float]]:
    """Every two views of a batch with the fraction of their cells that match."""
    together = itertools.combinations(range(len(names)), 2)
    return [(names[a], names[b], float(found.matched[a, b])) for a, b in together]


def _told(found: Correspondences) -> str:
    """How much the views of a batch have in common, for a person."""
    views = range(len(found.matched))
    shares = [float(found.matched[a, b]) for a, b in itertools.combinations(views, 2)]
    if not shares:
        return "one view: nothing to agree with"
    warning = "; the views see little of each other" if _mean(shares) < WEAK_MATCH else ""
    return (
        f"{_mean(shares):.0%} of cells matched per pair ({min(shares):.0%} to {max(shares):.0%}), "
        f"{found.covered.mean():.0%} in a cluster{warning}"
    )


def _mean(values: Iterator[float] | Sequence[float]) -> float:
    numbers = [float(v) for v in values]
    return sum(numbers) / len(numbers)
