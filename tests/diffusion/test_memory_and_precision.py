"""How much memory is free, and when the sampler takes bfloat16."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import torch

from gsedit.paper.diffusion import precision as memory
from gsedit.paper.diffusion.guidance import Branches, Need
from gsedit.paper.diffusion.precision import MAX_ERROR, InBfloat16, relative_error, with_precision
from gsedit.paper.diffusion.schedules import Schedule
from gsedit.paper.diffusion.settings import SamplerSettings
from gsedit.paper.editors import Capabilities, EditBatch
from gsedit.paper.editors.sampling import DiffusionEditor, prepared


def test_free_memory_respects_a_container(tmp_path, monkeypatch):
    assert memory.free_bytes() > 0
    (tmp_path / "memory.max").write_text("5000\n")
    (tmp_path / "memory.current").write_text("2000\n")
    assert memory._container_bytes(tmp_path) == 3000
    (tmp_path / "memory.max").write_text("max\n")
    assert memory._container_bytes(tmp_path) > 2**60


def _layers() -> torch.nn.Module:
    """A small convolutional network, of the same random weights always."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)  # modules offer no generator for their initial weights
        first, second = (torch.nn.Conv2d(*ends, 3, padding=1) for ends in ((4, 8), (8, 4)))
    return torch.nn.Sequential(first, torch.nn.GroupNorm(8, 8), torch.nn.SiLU(), second).eval()


@dataclass(frozen=True, eq=False)
class Painter:
    """A denoiser with a network that notes how many views it is given."""

    seen: list[int]
    name: str = "painter"
    cell: int = 1
    multiple: int = 1
    padding: str = "edge"
    predicts: str = "eps"
    schedule: Schedule = field(default_factory=Schedule.scaled_linear)
    layers: Any = field(default_factory=_layers)

    @property
    def capabilities(self):
        return Capabilities(runs_network=True)

    def check(self, prompt): ...

    def encode(self, images):
        return torch.nn.functional.pad(images, (0, 1)).movedim(-1, 1)

    def encode_edited(self, images, originals, prompt):
        return self.encode(images)

    def decode(self, latents):
        return latents[:, :3].movedim(1, -1)

    def condition(self, originals, prompt, generator):
        return None

    @torch.no_grad()
    def branches(self, x, t, condition, need):
        self.seen.append(len(x))
        out = self.layers(x)
        return Branches(*(out if needed else None for needed in need))


def test_bfloat16_only_where_it_errs_little():
    model = Painter([])
    x = torch.randn(1, 4, 8, 8, generator=torch.Generator().manual_seed(0))

    def guided(predictor: Any) -> torch.Tensor:
        text = predictor.branches(x, 500.0, None, Need(True, False, False)).text_image
        return text.float()

    assert with_precision(model, guided, "float32") is model
    assert isinstance(with_precision(model, guided, "bfloat16"), InBfloat16)
    rounded = with_precision(model, guided, "auto", supported=True)
    assert isinstance(rounded, InBfloat16)
    assert 0 < relative_error(guided(rounded), guided(model)) <= MAX_ERROR
    assert with_precision(model, guided, "auto", supported=False) is model

    def far_off(predictor: Any) -> torch.Tensor:
        return guided(predictor) * (1.1 if isinstance(predictor, InBfloat16) else 1.0)

    assert with_precision(model, far_off, "auto", supported=True) is model


def test_a_session_measures_once_and_counts_it(monkeypatch):
    monkeypatch.setattr("gsedit.paper.diffusion.precision.has_bfloat16", lambda: True)
    views, seen = torch.rand(2, 8, 8, 3, generator=torch.Generator().manual_seed(0)), []
    editor, counts = DiffusionEditor(Painter(seen)), []
    settings = SamplerSettings(steps=3)
    for _ in range(2):
        *_, last = editor.edit(EditBatch(views, views, "paint"), settings, torch.Generator())
        counts.append(last.evaluations)
    conditions, steps = 3, 3
    assert counts == [conditions * (2 * steps + 2), conditions * 2 * steps]
    assert seen.count(1) == 2  # rounded and not


def test_a_denoiser_without_a_network_is_left_alone():
    class WithoutNetwork(Painter):
        capabilities = Capabilities()

    model = WithoutNetwork([])
    x = torch.zeros(1, 4, 8, 8)
    assert prepared(model, x, torch.zeros(1, 8, 8, 3), "", SamplerSettings(), {}) == (model, 0)
