"""Do one run, with its error at held-out cameras measured as it goes, outside its clock."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.capture.fitting.settings import LossTerm, UpdateSettings
from gsedit.editing.edit import edit_steps
from gsedit.editing.result import EditResult
from gsedit.measures.decibels import rmse_from_psnr
from gsedit.paper.actions import Strategy
from gsedit.paper.diffusion.sampler import levels_of
from gsedit.paper.editors import make_editor
from gsedit.paper.editors.looks.recipe import parse
from gsedit.paper.editors.sampling import DiffusionEditor
from gsedit.paper.protocol import Editor
from gsedit.paper.session import Session
from gsedit.paper.settings import EditSettings, find_preset
from gsedit.paper.strategies import find_strategy
from research.paper.arms import PAPER, T_END_SHARE
from research.paper.cases import load_case
from research.paper.observe import EXACT, Observed, Observer, nearest_truth, rendered
from research.paper.runs import Case, Record, Run, read_record, write_record
from research.paper.varied import Varied
from research.provenance import provenance

_OWN: dict[tuple[Case, str], Float[Tensor, "1 v h w 3"]] = {}
"""An editor's own pictures of held-out views, which all runs on a scene share."""


@dataclass(frozen=True)
class SteppedUpdate(UpdateSettings):
    """Settings of an update in steps of Adam, whatever the loss."""

    @property
    def is_quadratic(self) -> bool:
        """False: a solve is not to be used."""
        return False


@dataclass(frozen=True)
class SwitchedUpdate(UpdateSettings):
    """Settings of an update whose steps fit the Gram matrices alone or the other terms alone."""

    switch: float = 0.5
    """Probability of the Gram matrices."""

    def terms_at(self, step: int) -> tuple[LossTerm, ...]:
        """The terms of one step, drawn by its number."""
        draw = torch.rand((), generator=torch.Generator().manual_seed(step))
        return tuple(t for t in self.terms if (t.name == "gram") == (float(draw) < self.switch))


def run_to_file(run: Run, folder: Path) -> Record:
    """The run's record; read from the folder where it is there already.

    Otherwise the folder gets KEY.json.
    """
    path = folder / f"{run.key}.json"
    if path.exists():
        return read_record(path)
    record = measure_run(run)
    write_record(path, run, record)
    return record


def measure_run(run: Run) -> Record:
    """Do a run and record it."""
    started = time.process_time()
    scene, dataset = load_case(run.case)
    observer = Observer(own=_OWN.get((run.case, run.editor)))
    *_, result = edit_steps(
        scene,
        run.case.prompt,
        editor=_editor(run.editor),
        generator=torch.Generator().manual_seed(run.seed),
        views=dataset,
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
    return replace(record, cpu=time.process_time() - started)


def strategy_of(run: Run) -> Strategy:
    """The arm's strategy, with its preset's values."""
    name, preset = run.arm.strategy, find_preset(run.arm.preset)
    made: Any = find_strategy(name)()
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
    averaged = None
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
    if averaged is None and run.arm.preset == PAPER:
        averaged = round(T_END_SHARE * base.sampler.step_count)
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


def _record(observer: Observer, session: Session, result: EditResult) -> Record:
    short = [
        row
        for row in result.metrics.evaluation.warp
        if row.pictures == "targets" and row.range == "short"
    ]
    truth = observer.truths[nearest_truth(observer.points)]
    finals = rendered(session, observer.views)
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
