"""How many views the sampler takes at once, and when it takes bfloat16."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import pytest
import torch
from closeness import NETWORK, assert_near
from untrained_network import untrained_network

from gsedit.errors import UsageError
from gsedit.paper.diffusion import memory
from gsedit.paper.diffusion.guidance import Branches, Need
from gsedit.paper.diffusion.memory import peak_bytes, views_at_once
from gsedit.paper.diffusion.precision import MAX_ERROR, InBfloat16, relative_error, with_precision
from gsedit.paper.diffusion.schedules import Schedule
from gsedit.paper.diffusion.settings import SamplerSettings
from gsedit.paper.editors import Capabilities, EditBatch
from gsedit.paper.editors.sampling import DiffusionEditor, prepared


def test_peak_is_what_is_held_at_one_time():
    def work() -> torch.Tensor:
        a = torch.ones(1000)  # 4 kB
        b = a * 2  # 8 kB held
        del a
        c = b.view(10, 100)  # no memory of its own
        c += 1
        return torch.cat((c, c))  # 4 + 8 kB

    assert peak_bytes(work) == 12_000
    given = torch.ones(1000)
    assert peak_bytes(lambda: given.add_(1)) == 0  # inputs are the caller's


def test_peak_grows_with_the_views():
    layers = untrained_network(channels=16, depth=1).layers
    with torch.no_grad():
        one, four = (peak_bytes(lambda n=n: layers(torch.zeros(n, 4, 16, 16))) for n in (1, 4))
    assert four == pytest.approx(4 * one, rel=0.05)


def test_views_that_fit_the_budget(monkeypatch):
    assert views_at_once(8, 10**9, 3.5) == 3
    assert views_at_once(8, 10**9, 0.1) == 1  # fewer than one cannot be
    assert views_at_once(2, 10**9, 30.0) == 2
    monkeypatch.setattr(memory, "free_bytes", lambda: 10 * 10**9)
    assert views_at_once(8, 10**9, None) == 5  # half of what is free
    with pytest.raises(UsageError, match="memory"):
        SamplerSettings(memory=0.0)


def test_free_memory_respects_a_container(tmp_path, monkeypatch):
    assert memory.free_bytes() > 0
    (tmp_path / "memory.max").write_text("5000\n")
    (tmp_path / "memory.current").write_text("2000\n")
    assert memory._container_bytes(tmp_path) == 3000
    (tmp_path / "memory.max").write_text("max\n")
    assert memory._container_bytes(tmp_path) > 2**60


def test_bfloat16_only_where_it_errs_little():
    model = untrained_network(channels=16, depth=2)
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


@dataclass(frozen=True, eq=False)
class Painter:
    """A denoiser with a network that notes how many views it is given at once."""

    seen: list[int]
    micro_batch: int = 1
    name: str = "painter"
    cell: int = 1
    multiple: int = 1
    padding: str = "edge"
    predicts: str = "eps"
    schedule: Schedule = field(default_factory=Schedule.scaled_linear)
    layers: Any = field(default_factory=lambda: untrained_network(channels=8, depth=1).layers)

    @property
    def capabilities(self):
        return Capabilities(with_micro_batch=lambda views: replace(self, micro_batch=views))

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
        parts = x.split(self.micro_batch)
        self.seen.extend(len(part) for part in parts)
        out = torch.cat([self.layers(part) for part in parts])
        return Branches(*(out if needed else None for needed in need))


def test_the_editor_gives_a_network_as_many_views_as_fit():
    views = torch.rand(5, 8, 8, 3, generator=torch.Generator().manual_seed(0))
    batch = EditBatch(views, views, "paint")
    fine = SamplerSettings(steps=1, precision="float32")
    results = []
    for budget, expected in ((1e-12, [1] * 5), (10.0, [5])):
        seen: list[int] = []
        editor = DiffusionEditor(Painter(seen))
        *_, last = editor.edit(batch, replace(fine, memory=budget), torch.Generator())
        assert seen == [1, *expected]  # the first view is measured
        results.append(last.images)
    # a batch of another size may take another convolution kernel: roundings only
    assert_near(results[0], results[1], NETWORK)


def test_a_session_measures_once_and_counts_it():
    views, seen = torch.rand(2, 8, 8, 3, generator=torch.Generator().manual_seed(0)), []
    editor, counts = DiffusionEditor(Painter(seen)), []
    settings = SamplerSettings(steps=3, precision="float32")
    for _ in range(2):
        *_, last = editor.edit(EditBatch(views, views, "paint"), settings, torch.Generator())
        counts.append(last.evaluations)
    conditions, steps = 3, 3
    assert counts == [conditions * (2 * steps + 1), conditions * 2 * steps]
    assert seen.count(1) == 1


def test_a_denoiser_without_a_network_is_left_alone():
    class WithoutNetwork(Painter):
        capabilities = Capabilities()

    model = WithoutNetwork([])
    x = torch.zeros(1, 4, 8, 8)
    assert prepared(model, x, torch.zeros(1, 8, 8, 3), "", SamplerSettings(), {}) == (model, 0)
