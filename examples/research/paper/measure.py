"""Do one run, with its error at held-out cameras measured as it goes, outside its clock."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.bench.edit import EXACT, Observed, Observer, nearest_truth
from gsedit.bench.provenance import provenance
from gsedit.diffusion.sampler import levels_of
from gsedit.editing.edit import edit_steps
from gsedit.editing.session.actions import Action, Strategy
from gsedit.editing.session.edit_views import edit_views
from gsedit.editing.session.presets import find_preset
from gsedit.editing.session.result import EditResult
from gsedit.editing.session.session import Session, render_edited
from gsedit.editing.session.settings import EditSettings
from gsedit.editing.strategies import find_strategy
from gsedit.editing.strategies._dataset import EditAlone, alone
from gsedit.editing.strategies.iterative import Iterative
from gsedit.editor_protocol import Editor
from gsedit.editors import make_editor
from gsedit.editors.looks.recipe import parse
from gsedit.editors.sampling import DiffusionEditor
from gsedit.measures.decibels import rmse_from_psnr
from gsedit.runs.events import Event
from research.loss_switch import SteppedUpdate, SwitchedUpdate
from research.paper.arms import PAPER, PAPER_T_END
from research.paper.cases import load_case
from research.paper.runs import Case, Record, Run, read_record, write_record
from research.paper.varied import Varied
from research.strategies.clip import load_clip

_OWN: dict[tuple[Case, str], Float[Tensor, "1 v h w 3"]] = {}
"""An editor's own pictures of held-out views, which all runs on a scene share."""


def run_to_files(run: Run, folder: Path, clip: Path | None = None) -> Record:
    """The run's record; read from the folder where it is there already.

    Otherwise the folder gets KEY.json, and KEY.png: two unedited views and what the editor made of
    them, a held-out view unedited, edited, and as it should be. `clip`: a folder of CLIP's weights.
    """
    path = folder / f"{run.key}.json"
    if path.exists():
        return read_record(path)
    record, pictures = measure_run(run, clip)
    _write_strip(folder / f"{run.key}.png", pictures)
    write_record(path, run, record)
    return record


def measure_run(run: Run, clip: Path | None = None) -> tuple[Record, list[Float[Tensor, "h w 3"]]]:
    """The record of a run, and its pictures."""
    started = time.process_time()
    scene, dataset = load_case(run.case)
    observer = Watching(own=_OWN.get((run.case, run.editor)), clip=clip)
    *_, result = edit_steps(
        scene,
        run.case.prompt,
        editor=_editor(run.editor),
        generator=torch.Generator().manual_seed(run.seed),
        dataset=dataset,
        settings=settings_of(run),
        strategy=Observed(strategy_of(run), observer),
    )
    assert isinstance(result, EditResult)
    session = observer.session
    assert session is not None
    if observer.own is not None:
        _OWN[run.case, run.editor] = observer.own
    elif run.editor == Varied.name:  # its true edit is the first variant, whatever is nearer
        observer.points = [replace(p, errors=p.errors[:1]) for p in observer.points]
    record = _record(observer, session, result)
    pictures = _pictures(observer, session)
    return replace(record, cpu=time.process_time() - started), pictures


@dataclass(eq=False)
class Watching(Observer):
    """An observer that also asks CLIP how much the scene looks as the instruction says."""

    clip: Path | None = None
    similarity: list[float] = field(default_factory=list)

    def _measure(self, session: Session, editing: float) -> None:
        super()._measure(session, editing)
        if self.clip is not None:
            clip = load_clip(self.clip)
            finals = torch.stack(list(render_edited(session, self.views).values()))
            texts = clip.texts([_object(session.request.prompt)] * len(finals))
            self.similarity.append(float((clip.images(finals) * texts).sum(-1).mean()))


def _object(prompt: str) -> str:
    """The text about the target, as the paper has it: a prompt without its verb."""
    for begin in ("turn it into ", "as ", "make it "):
        prompt = prompt.removeprefix(begin)
    return prompt


@dataclass(frozen=True)
class SharedIterative(Iterative):
    """The iterative update whose edits all start from the same noise."""

    def schedule(self, session: Session) -> Iterator[Action]:
        """The actions of Iterative, with shared noise in the edits."""
        for action in super().schedule(session):
            yield SharedEdit(**vars(action)) if isinstance(action, EditAlone) else action


@dataclass(frozen=True)
class SharedEdit(EditAlone):
    """Edit one view from a noise level that is drawn anew, and the draws of the session's seed."""

    def __call__(self, session: Session) -> Iterator[Event]:
        draw = float(torch.rand((), generator=session.request.generator))
        strength = self.least_noise + (self.most_noise - self.least_noise) * draw
        sampler = alone(session.request.settings.sampler, strength)
        sampler = replace(sampler, noise="shared")
        number, of = self.step, self.steps
        yield from edit_views(session, (self.view,), step=number, steps=of, sampler=sampler)


def strategy_of(run: Run) -> Strategy:
    """The arm's strategy, with its preset's values."""
    name, preset = run.arm.strategy, find_preset(run.arm.preset)
    made: Any = SharedIterative() if name == "iterative-shared" else find_strategy(name)()
    return replace(preset.applied_to(made), **run.arm.options)


def _editor(name: str) -> Editor:
    return DiffusionEditor(Varied()) if name == Varied.name else make_editor(name)


def settings_of(run: Run) -> EditSettings:
    """The arm's settings, over what all runs share: the whole picture is edited."""
    base = find_preset(run.arm.preset).settings
    base = replace(
        base,
        update=replace(base.update, patches=run.case.patches, patch=run.case.patch),
        sampler=replace(base.sampler, precision="float32"),
        held_out_edits=0,
        region="all",
        coverage=1.0,
    )
    averaged = PAPER_T_END if run.arm.preset == PAPER else None
    for name, value in run.arm.settings.items():
        record, _, inner = name.rpartition(".")
        update = {each.name: getattr(base.update, each.name) for each in fields(base.update)}
        match name:
            case "update.switch":
                base = replace(base, update=SwitchedUpdate(**update, switch=value))
            case "update.stepped":
                base = replace(base, update=SteppedUpdate(**update))
            case "averaged_steps":
                averaged = value
            case _ if record:
                base = replace(base, **{record: replace(getattr(base, record), **{inner: value})})
            case _:
                base = replace(base, **{inner: value})
    if averaged is None or run.arm.strategy.startswith("iterative"):
        return base
    return replace(base, sampler=_averaged(base, run.editor, averaged))


def _averaged(settings: EditSettings, editor: str, steps: int) -> Any:
    """The sampler's settings with averaging in the first `steps`, on the editor's own schedule."""
    denoiser = _editor(editor).capabilities.denoiser
    assert denoiser is not None
    levels = levels_of(denoiser.schedule, settings.sampler)
    consensus = settings.sampler.consensus and steps > 0
    return replace(settings.sampler, consensus=consensus, t_end=levels[steps].sigma)


def _record(observer: Watching, session: Session, result: EditResult) -> Record:
    short = [
        row
        for row in result.metrics.evaluation.warp
        if row.pictures == "targets" and row.range == "short"
    ]
    truth = observer.truths[nearest_truth(observer.points)]
    finals = torch.stack(list(render_edited(session, observer.views).values()))
    targets, originals = (
        [view.image for view in views] for views in (result.targets, result.originals)
    )
    expected, target_error = originals, None
    if observer.kind == EXACT and targets:
        variants = parse(result.prompt).variants(torch.stack(originals))
        variants = variants[: len(observer.points[0].errors)]
        squares = (variants - torch.stack(targets)).double().square().mean((1, 2, 3, 4))
        expected = list(variants[int(squares.argmin())])
        target_error = float(squares.min().sqrt())
    return Record(
        curve=tuple(observer.points),
        truth=observer.kind,
        disagreement=short[0].edited if short else None,
        unedited_disagreement=short[0].unedited if short else None,
        matched=result.metrics.matched,
        target_error=target_error,
        residual=rmse_of(result.metrics.psnr_to_targets),
        target_sharpness=energy(targets) / energy(expected) if targets else 0.0,
        sharpness=energy(finals) / energy(truth),
        similarity=tuple(observer.similarity),
        cpu=0.0,
        **vars(provenance()),
    )


def rmse_of(psnr: float | None) -> float | None:
    """The RMSE of a PSNR, if there is one."""
    return None if psnr is None else rmse_from_psnr(psnr)


def energy(pictures: Sequence[Float[Tensor, "h w 3"]] | Float[Tensor, "v h w 3"]) -> float:
    """Mean squared difference of neighboring pixels."""
    return sum(
        float(p.double().diff(dim=axis).square().mean()) for p in pictures for axis in (0, 1)
    ) / len(pictures)


def _pictures(observer: Observer, session: Session) -> list[Float[Tensor, "h w 3"]]:
    """Two unedited views, what the editor made of them (else unedited), a held-out view unedited,
    edited, and as it should be."""
    first = session.surveyed.plan.batches[0][:2]
    shown = (first * 2)[:2]
    unedited = {i: session.unedited.picture(i) for i in shown}
    targets = {i: view.image for i, view in session.progress.edited.targets.items()}
    return [
        *(unedited[i] for i in shown),
        *(targets.get(i, unedited[i]) for i in shown),
        session.unedited.picture(observer.views[0]),
        *render_edited(session, observer.views[:1]).values(),
        observer.truths[nearest_truth(observer.points)][0],
    ]


def _write_strip(path: Path, pictures: Sequence[Float[Tensor, "h w 3"]]) -> None:
    from gsedit.formats.pictures import as_picture
    from gsedit.storage.atomic import atomic_path

    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_path(path, overwrite=True) as temporary:
        as_picture(torch.cat(list(pictures), 1)).save(temporary, format="png")
