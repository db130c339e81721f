"""Running `gsedit` in a test, and what stands in for the long work behind it."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

import torch
from gsedit_cli import main as cli
from typer.testing import CliRunner

from gsedit import Checkpoint, Event, FitResult
from gsedit.fitting.fit import RATES
from gsedit.fitting.optimizer import SceneOptimizer
from gsedit.runs.state import State
from rasterizer import Gaussians


def gsedit(*words: object):
    return CliRunner().invoke(cli.app, [str(word) for word in words])


def files(folder: Path) -> dict[Path, bytes]:
    return {p: p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def one_line(text: str) -> bool:
    return text.count("\n") == 1 and text.endswith("\n")


def stub_fit(monkeypatch, *, end: BaseException | None = None, checkpoints: int = 1):
    """Replace the fit by one that yields an event, checkpoints, and then a result or an error."""
    given = {}

    def fit_steps(dataset, settings, *, generator, start=None, resume=None, ranks=None):
        given.update(dataset=dataset, settings=settings, start=start, resume=resume)
        given["seed"] = generator.initial_seed()
        result = stub_scene()
        yield Event("fit", 1.0, 1, 2, 0.5, 0.1)
        for step in range(1, checkpoints + 1):
            yield stub_checkpoint(10 * step)
        if end is not None:
            raise end
        yield FitResult(result, 20.0, 2, 2.0, ((2.0, 20.0),))

    # not by dotted name: gsedit.fit is also the function of that name
    monkeypatch.setattr(import_module("gsedit.fitting.fit"), "fit_steps", fit_steps)
    return given


def stub_checkpoint(step: int) -> Checkpoint:
    """Checkpoint of a fit in which all of `stub_scene` moves."""
    state = SceneOptimizer(stub_scene(), RATES).state()
    tensors = {f"optimizer.{name}": each for name, each in state.items()}
    return Checkpoint(State({"events": []}, tensors), step, 1.5, stub_scene)


def stub_scene():
    n = 3
    quats = torch.tensor([1.0, 0, 0, 0]).repeat(n, 1)
    zeros = torch.zeros(n, 3)
    return Gaussians(zeros, quats, zeros, torch.zeros(n), torch.zeros(n, 1, 3))
