"""Do one run, with its error at held-out cameras measured as it goes, outside its clock."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.bench.edit import EXACT, Observed, Observer, nearest_truth
from gsedit.bench.provenance import provenance
from gsedit.editing.edit import edit_steps
from gsedit.editing.session.result import EditResult
from gsedit.editing.session.session import Session, render_edited
from gsedit.editing.session.settings import EditSettings
from gsedit.editing.strategies import find_strategy
from gsedit.editors import make_editor
from gsedit.editors.looks.recipe import parse
from gsedit.fitting.settings import UpdateSettings
from research.loss_switch import SwitchedUpdate
from research.paper.cases import load_case
from research.paper.runs import Record, Run, read_record, write_record


def run_to_files(run: Run, folder: Path) -> Record:
    """The run's record; read from the folder where it is there already.

    Otherwise the folder gets KEY.json, and KEY.png: two unedited views and what the editor made of
    them, a held-out view unedited, edited, and as it should be.
    """
    path = folder / f"{run.key}.json"
    if path.exists():
        return read_record(path)
    record, pictures = measure_run(run)
    _write_strip(folder / f"{run.key}.png", pictures)
    write_record(path, run, record)
    return record


def measure_run(run: Run) -> tuple[Record, list[Float[Tensor, "h w 3"]]]:
    """The record of a run, and its pictures."""
    scene, dataset = load_case(run.case)
    observer = Observer()
    strategy = find_strategy(run.arm.strategy)(**run.arm.options)
    *_, result = edit_steps(
        scene,
        run.case.prompt,
        editor=make_editor(run.editor),
        generator=torch.Generator().manual_seed(run.seed),
        dataset=dataset,
        settings=_settings(run),
        strategy=Observed(strategy, observer),
    )
    assert isinstance(result, EditResult)
    assert observer.session is not None
    return _record(observer, observer.session, result), _pictures(observer, observer.session)


def _settings(run: Run) -> EditSettings:
    """The arm's settings, over what all runs share: the whole picture is edited."""
    base = EditSettings(
        update=UpdateSettings(patches=run.case.patches, patch=run.case.patch),
        held_out_edits=0,
        region="all",
        coverage=1.0,
    )
    base = replace(base, sampler=replace(base.sampler, precision="float32"))
    for name, value in run.arm.settings.items():
        record, _, inner = name.rpartition(".")
        if name == "update.switch":
            update = {field.name: getattr(base.update, field.name) for field in fields(base.update)}
            value, inner = SwitchedUpdate(**update, switch=value), "update"
        elif record:
            value, inner = replace(getattr(base, record), **{inner: value}), record
        base = replace(base, **{inner: value})
    return base


def _record(observer: Observer, session: Session, result: EditResult) -> Record:
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
        target_sharpness=_energy(targets) / _energy(expected) if targets else 0.0,
        sharpness=_energy(finals) / _energy(truth),
        strength=result.metrics.rmse_to_unedited or 0.0,
        **vars(provenance()),
    )


def _energy(pictures: Sequence[Float[Tensor, "h w 3"]] | Float[Tensor, "v h w 3"]) -> float:
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
