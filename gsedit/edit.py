"""Efficient-NeRF2NeRF on Gaussians, from a sentence to an edited scene: knows everyone."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit import metrics, strategies
from gsedit.correspond import Correspondences, correspond
from gsedit.diffusion import SamplerSettings
from gsedit.editors.protocol import EditBatch, Editor, KnowsAnswer
from gsedit.errors import UsageError
from gsedit.features import FeatureExtractor, FilterBank
from gsedit.optimiser import SceneOptimiser
from gsedit.plan import Plan, plan_views, survey
from gsedit.report import Checkpoint, Event
from gsedit.strategies import UpdateSettings, update_steps
from gsedit.views import Dataset, View, bounds, capture, orbit
from rasterizer.camera import Camera
from rasterizer.render import Rendering, render
from rasterizer.scene import Gaussians

ORBIT_VIEWS = 24
"""Cameras placed around a scene that has none: 15 degrees apart, so that neighbours overlap."""
WEAK_MATCH = 0.1
"""Below this fraction of matched cells, views agree on too little: worth a warning."""
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
    matched: float
    """Mean fraction of latent cells matched between two views of a batch."""
    strength: float
    """RMSE between original and final renders: 0 is no edit at all."""
    residual: float
    """PSNR of the final renders against the 2D targets, dB."""
    answer: float | None
    """PSNR to the known answer at cameras that were never edited, dB; None if there is none."""
    timings: dict[str, float]
    """Seconds per stage."""


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
    settings = settings or EditSettings()
    features = features or FilterBank()
    editor.check(prompt)
    if not len(scene):
        raise UsageError("the scene is empty: there is nothing to edit")
    views, held_out = _views(scene, dataset)
    watch, scene = _Watch(), scene.detach()

    yield Event("survey", watch.seconds, note=f"{len(views)} views")
    with watch.stage("survey"):
        weights = survey(scene, [v.camera for v in views])
        plan = plan_views(weights, settings.views_per_round, settings.rounds, settings.coverage)
    note = f"{len(plan.views)} views cover {plan.coverage[-1]:.0%} of what all views see"
    yield Event("survey", watch.seconds, len(views), len(views), note=note)

    with watch.stage("render"):
        before = {i: _render(scene, views[i].camera) for i in plan.views}
        unedited = [_render(scene, v.camera).color for v in held_out]
    originals = {i: _original(views[i], before[i], settings) for i in plan.views}
    radius = bounds(scene.means, scene.opacities).radius
    optimiser = SceneOptimiser(scene, strategies.rates(settings.geometry, radius))
    targets: dict[int, View] = {}
    matches: list[float] = []
    answer: Callable[[Tensor], Tensor] | None = None

    for number, batch in enumerate(plan.rounds):
        members = (*batch, *_anchor(weights, batch, targets))
        with watch.stage("correspond"):
            found = _correspondences(before, members, views, editor.cell)
        matches.append(_mean_match(found))
        yield Event("correspond", watch.seconds, number + 1, len(plan.rounds), note=_told(found))
        batch_in = _batch(optimiser.scene.detach(), members, batch, views, originals, targets,
                          prompt, found if settings.sampler.consensus else None)  # fmt: skip
        with watch.stage("sample"):
            images = None
            for progress in editor.edit(batch_in, settings.sampler, generator):
                yield Event("sample", watch.seconds, progress.step, progress.steps)
                images = progress.images
        if images is None:
            raise RuntimeError(f"editor {editor.name} ended without images")
        for i, image in zip(members, images):
            targets.setdefault(i, replace(views[i], image=image.to(scene.means)))
        if isinstance(editor, KnowsAnswer):
            answer = editor.answer(
                prompt,
                torch.stack([targets[i].image for i in targets]),
                torch.stack([originals[i] for i in targets]),
            )
        done = number * settings.update.steps
        total = len(plan.rounds) * settings.update.steps
        fitted = tuple(targets.values())
        with watch.stage("update"):
            steps = update_steps(optimiser, fitted, settings.update, features, generator)
            for step, loss in enumerate(steps, start=done + 1):
                if step % MEASURE_EVERY == 0:
                    psnr, aim = _measure(
                        optimiser.scene.detach(), held_out[:PROBES], unedited, answer, fitted
                    )
                    note = f"{psnr:.2f} dB to the {aim}"
                    yield Event(
                        "update", watch.seconds, step, total, loss, 10 ** (-psnr / 20), note
                    )
                elif step % REPORT_EVERY == 0:
                    yield Event("update", watch.seconds, step, total, loss)
        yield Checkpoint(optimiser.scene.detach(), done + settings.update.steps, watch.seconds)

    edited = optimiser.scene.detach().map(torch.clone)
    with watch.stage("measure"):
        names = [views[i].name for i in targets]
        finals = capture(edited, [views[i].camera for i in targets], names)
        psnr, aim = _measure(edited, held_out, unedited, answer, tuple(targets.values()))
    shown = tuple(replace(views[i], image=before[i].color.clamp(0, 1)) for i in targets)
    result = EditResult(
        scene=edited,
        originals=shown,
        targets=tuple(targets.values()),
        finals=finals,
        settings=settings,
        plan=plan,
        matched=sum(matches) / len(matches),
        strength=_mean(metrics.rmse(a.image, b.image) for a, b in zip(shown, finals)),
        residual=_mean(metrics.psnr(f.image, t.image) for f, t in zip(finals, targets.values())),
        answer=psnr if answer is not None and held_out else None,
        timings=watch.stages | {"total": watch.seconds},
    )
    where = f"at {len(held_out)} held-out cameras" if result.answer is not None else "of the edit"
    note = f"{psnr:.2f} dB to the {aim} {where}"
    yield Event("measure", watch.seconds, error=10 ** (-psnr / 20), note=note)
    yield result


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
    """`edit_steps` to the end, with the built-in editor if none is given."""
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


def _views(scene: Gaussians, dataset: Dataset | None) -> tuple[tuple[View, ...], tuple[View, ...]]:
    """(views that may be edited, views that are only measured at)."""
    if dataset is None:
        cameras = orbit(scene, ORBIT_VIEWS, 256)
        names = [f"orbit_{i:02d}" for i in range(ORBIT_VIEWS)]
        dataset = Dataset(capture(scene.detach(), cameras, names))
    sizes = {(v.camera.width, v.camera.height) for v in dataset.views}
    if len(sizes) != 1:
        told = ", ".join(f"{w}x{h}" for w, h in sorted(sizes)) or "none"
        raise UsageError(f"views must have one size to be edited together, these have {told}")
    views, held_out = dataset.split()
    return (views, held_out) if views else (held_out, ())


@torch.no_grad()
def _render(scene: Gaussians, camera: Camera) -> Rendering:
    return render(scene, camera, median_depth=True)


def _original(view: View, rendered: Rendering, settings: EditSettings) -> Float[Tensor, "h w 3"]:
    """What the editor sees as the unedited picture."""
    picture = view.image if settings.condition == "photo" else rendered.color
    return picture.clamp(0, 1).to(rendered.color)


def _anchor(
    weights: Float[Tensor, "v n"], batch: Sequence[int], targets: dict[int, View]
) -> tuple[int, ...]:
    """The finished view that sees most of what the new ones see: it ties the rounds together."""
    if not targets:
        return ()
    shared = weights[list(batch)].sum(0)
    return (max(targets, key=lambda i: float(torch.minimum(weights[i], shared).sum())),)


def _correspondences(
    before: dict[int, Rendering], members: Sequence[int], views: Sequence[View], cell: int
) -> Correspondences:
    depths = [before[i].median_depth for i in members]
    return correspond(
        [views[i].camera for i in members],
        torch.stack([d for d in depths if d is not None]),
        torch.stack([before[i].alpha for i in members]),
        cell=cell,
    )


def _mean_match(found: Correspondences) -> float:
    """Mean matched fraction over ordered pairs of different views; 1 for a single view."""
    count = len(found.matched)
    if count == 1:
        return 1.0
    return float((found.matched.sum() - found.matched.diagonal().sum()) / (count * (count - 1)))


def _told(found: Correspondences) -> str:
    off = found.matched[~torch.eye(len(found.matched), dtype=torch.bool)]
    if not len(off):
        return "one view: nothing to agree with"
    pairs = f"{off.mean():.0%} of cells matched per pair ({off.min():.0%} to {off.max():.0%})"
    in_clusters = f"{float((found.labels >= 0).double().mean()):.0%} in a cluster"
    warning = "; the views see little of each other" if off.mean() < WEAK_MATCH else ""
    return f"{pairs}, {in_clusters}{warning}"


def _batch(
    scene: Gaussians, members: Sequence[int], batch: Sequence[int], views: Sequence[View],
    originals: dict[int, Tensor], targets: dict[int, View], prompt: str,
    found: Correspondences | None,
) -> EditBatch:  # fmt: skip
    """Current renders of the new views, and the anchor as it was edited."""
    fresh = {v.name: v.image for v in capture(scene, [views[i].camera for i in batch],
                                              [views[i].name for i in batch])}  # fmt: skip
    images = [targets[i].image if i in targets else fresh[views[i].name] for i in members]
    return EditBatch(
        images=torch.stack(images),
        originals=torch.stack([originals[i] for i in members]),
        prompt=prompt,
        correspondences=found,
        anchored=torch.tensor([i in targets for i in members]),
    )


def _measure(
    scene: Gaussians,
    held_out: Sequence[View],
    unedited: Sequence[Tensor],
    answer: Callable[[Tensor], Tensor] | None,
    targets: Sequence[View],
) -> tuple[float, str]:
    """PSNR against the known answer where nothing was edited, or else against the 2D targets."""
    if answer is not None and held_out:
        truths = [answer(picture.clamp(0, 1)[None])[0] for picture in unedited[: len(held_out)]]
        aims = [(v.camera, truth) for v, truth in zip(held_out, truths)]
    else:
        aims = [(v.camera, v.image) for v in targets]
    with torch.no_grad():
        found = [metrics.psnr(render(scene, c).color.clamp(0, 1), t) for c, t in aims]
    return _mean(found), "known answer" if answer is not None and held_out else "edited pictures"


def _mean(values: Iterator[float] | Sequence[float]) -> float:
    numbers = [float(v) for v in values]
    return sum(numbers) / len(numbers)
