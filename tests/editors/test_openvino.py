"""Networks computed by OpenVINO: equal to torch's, kept on disk, and chosen only where better."""

from __future__ import annotations

from importlib.util import find_spec

import pytest
import torch
from closeness import NETWORK, assert_near
from tiny_models import tiny_unet

from gsedit.paper.models import runtime
from gsedit.paper.models.runtime import in_torch
from gsedit.paper.models.stable_diffusion import _predicted

if find_spec("openvino") is None:  # importing it here would start its telemetry, in processes
    pytest.skip("needs gsedit[openvino]", allow_module_level=True)


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "gsedit" / "openvino"


def inputs(rows: int) -> tuple[torch.Tensor, ...]:
    g = torch.Generator().manual_seed(rows)
    x = torch.randn(rows, 8, 8, 8, generator=g)
    return x, torch.full((rows,), 500.0), torch.randn(rows, 5, 32, generator=g)


def linear(network: torch.nn.Module, x: torch.Tensor) -> torch.Tensor:
    return network(x)


def close(a: torch.Tensor, b: torch.Tensor) -> None:
    assert_near(a, b, NETWORK)


def test_equal_to_torch_whatever_the_number_of_rows(monkeypatch):
    with torch.random.fork_rng():
        torch.manual_seed(0)
        unet = tiny_unet().eval().requires_grad_(False)
    """Rows are computed a few at a time, always as many: the network is traced once."""
    run, traced = runtime.OpenVino(), []
    whole = runtime._traced
    monkeypatch.setattr(runtime, "_traced", lambda *a: traced.append(a) or whole(*a))
    for rows in (3, 9, 1, 5):
        given = inputs(rows)
        close(run(_predicted, unet, *given), in_torch(_predicted, unet, *given))
    assert len(traced) == 1


def test_second_start_reads_the_graph_and_a_damaged_one_is_made_again(cache, monkeypatch):
    layer, x = torch.nn.Linear(4, 4).requires_grad_(False), torch.ones(2, 4)
    expected = layer(x)
    close(runtime.OpenVino()(linear, layer, x), expected)
    (graph,) = cache.iterdir()
    assert runtime.cached_bytes() > 0
    with monkeypatch.context() as patch:
        patch.setattr(runtime, "_traced", None)  # it would raise
        close(runtime.OpenVino()(linear, layer, x), expected)
    (graph / "graph.xml").write_text("damaged")
    close(runtime.OpenVino()(linear, layer, x), expected)
    assert [each.name for each in cache.iterdir()] == [graph.name]
    assert "damaged" not in (graph / "graph.xml").read_text()


def fixed(network: torch.nn.Module, x: torch.Tensor) -> torch.Tensor:
    return network(x) * float(x.sum())  # a number of the first input becomes a constant


def test_auto_notices_a_number_that_tracing_fixed():
    layer, x = torch.nn.Linear(4, 4).requires_grad_(False), torch.ones(2, 4)
    run = runtime.Faster(runtime.OpenVino(), least_weights=0)
    for factor in (1.0, 3.0):
        close(run(fixed, layer, factor * x), fixed(layer, factor * x))
    (reason,) = run.chosen[layer].values()
    assert reason.startswith("torch")
