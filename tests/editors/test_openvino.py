"""Networks computed by OpenVINO: equal to torch's, kept on disk, and chosen only where better."""

from __future__ import annotations

import gc
import os
import weakref
from importlib.util import find_spec

import pytest
import torch
from closeness import NETWORK, assert_near
from tiny_models import tiny_unet

from gsedit.errors import GseditError, UsageError
from gsedit.models import runtime
from gsedit.models.runtime import in_torch, make_runtime
from gsedit.models.stable_diffusion import _predicted

if find_spec("openvino") is None:  # importing it here would start its telemetry, in processes
    pytest.skip("needs gsedit[openvino]", allow_module_level=True)

REAL_PROCESSOR = pytest.mark.skipif(
    "ONEDNN_MAX_CPU_ISA" in os.environ,
    reason="OpenVINO plans bfloat16 for the real processor, and oneDNN is held to another",
)


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "gsedit" / "openvino"


@pytest.fixture(scope="module")
def unet():
    with torch.random.fork_rng():
        torch.manual_seed(0)
        return tiny_unet().eval().requires_grad_(False)


def inputs(rows: int) -> tuple[torch.Tensor, ...]:
    g = torch.Generator().manual_seed(rows)
    x = torch.randn(rows, 8, 8, 8, generator=g)
    return x, torch.full((rows,), 500.0), torch.randn(rows, 5, 32, generator=g)


def linear(network: torch.nn.Module, x: torch.Tensor) -> torch.Tensor:
    return network(x)


def close(a: torch.Tensor, b: torch.Tensor) -> None:
    assert_near(a, b, NETWORK)


def test_equal_to_torch_whatever_the_number_of_rows(unet, monkeypatch):
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


def test_other_weights_and_another_shape_have_a_graph_of_their_own(cache):
    layer = torch.nn.Linear(4, 4).requires_grad_(False)
    for x in (torch.ones(2, 4), torch.ones(2, 3, 4)):
        close(runtime.OpenVino()(linear, layer, x), layer(x))
    layer.weight[0, 0] += 1
    close(runtime.OpenVino()(linear, layer, torch.ones(2, 4)), layer(torch.ones(2, 4)))
    assert len(list(cache.iterdir())) == 3


def test_the_cache_is_bounded_and_the_longest_unused_goes(cache, monkeypatch):
    monkeypatch.setattr(runtime, "MOST_BYTES", 1000)

    def write(path):
        path.write_bytes(bytes(100))
        path.with_name("graph.bin").write_bytes(bytes(300))

    for name in ("a", "b", "c"):
        assert runtime.keep(name, 400, write).exists()
    assert sorted(each.name for each in cache.iterdir()) == ["b", "c"]
    with pytest.raises(OSError, match="no room"):
        runtime.keep("huge", 2000, write)


@REAL_PROCESSOR
def test_bfloat16_where_torch_would_take_it():
    layer = torch.nn.Linear(64, 64).requires_grad_(False)
    x = torch.randn(2, 64, generator=torch.Generator().manual_seed(0))
    with torch.autocast("cpu", dtype=torch.bfloat16):
        rounded = runtime.OpenVino()(linear, layer, x)
    assert rounded.dtype == torch.float32
    assert (rounded - layer(x)).norm() / layer(x).norm() < 0.02


@REAL_PROCESSOR
def test_weights_in_16_bits_are_traced_in_32():
    half = torch.nn.Sequential(torch.nn.Conv2d(4, 8, 3), torch.nn.GroupNorm(2, 8))
    half, x = half.bfloat16().requires_grad_(False), torch.ones(1, 4, 8, 8).bfloat16()
    found = runtime.OpenVino()(linear, half, x)
    assert found.dtype == next(half.parameters()).dtype == torch.bfloat16
    assert (found.float() - half.float()(x.float())).norm() < 0.02 * found.float().norm() + 0.01


@pytest.mark.parametrize(("error", "expected"), [(0.0, "openvino"), (0.1, "torch")])
def test_auto_takes_what_is_faster_and_right(monkeypatch, error, expected):
    layer, x = torch.nn.Linear(4, 4).requires_grad_(False), torch.ones(2, 4)
    clock = iter([0.0, 5.0, 5.0, 6.0])  # torch 5 s, OpenVINO 1 s
    monkeypatch.setattr(runtime, "_seconds", lambda: next(clock))
    monkeypatch.setattr(runtime, "LEAST_WEIGHTS", 0)

    def fake(forward, network, *given):
        return forward(network, *given) * (1 + error)

    run = runtime.Faster(fake)
    run(linear, layer, x)
    close(run(linear, layer, x), layer(x))
    (reason,) = run.chosen[layer].values()
    assert reason.startswith(expected)


def fixed(network: torch.nn.Module, x: torch.Tensor) -> torch.Tensor:
    return network(x) * float(x.sum())  # a number of the first input becomes a constant


def test_auto_notices_a_number_that_tracing_fixed(monkeypatch):
    monkeypatch.setattr(runtime, "LEAST_WEIGHTS", 0)
    layer, x = torch.nn.Linear(4, 4).requires_grad_(False), torch.ones(2, 4)
    run = runtime.Faster(runtime.OpenVino())
    for factor in (1.0, 3.0):
        close(run(fixed, layer, factor * x), fixed(layer, factor * x))
    (reason,) = run.chosen[layer].values()
    assert reason.startswith("torch")


def test_auto_leaves_to_torch_what_does_not_fit_into_memory(monkeypatch):
    monkeypatch.setattr(runtime, "LEAST_WEIGHTS", 0)
    monkeypatch.setattr(runtime, "free_bytes", lambda: 10)
    layer, x = torch.nn.Linear(4, 4).requires_grad_(False), torch.ones(2, 4)
    run = runtime.Faster(runtime.OpenVino())
    close(run(linear, layer, x), layer(x))
    with pytest.raises(GseditError, match="GB are free: add --runtime torch"):
        run.openvino(linear, layer, x)


def test_networks_are_not_kept_alive_and_what_was_compiled_goes_with_them():
    run, faster = runtime.OpenVino(), runtime.Faster(in_torch)
    for _ in range(2):
        layer = torch.nn.Linear(4, 4).requires_grad_(False)
        x = torch.ones(2, 4)
        close(run(linear, layer, x), layer(x))
        faster.chosen[layer] = {}
        gone = weakref.ref(layer)
        del layer
        gc.collect()
        assert gone() is None
        assert not run._compiled
        assert not faster.chosen


def test_runtimes_by_name(monkeypatch):
    assert make_runtime("torch") is in_torch
    assert isinstance(make_runtime("auto"), runtime.Faster)
    with pytest.raises(UsageError, match="torch, openvino or auto"):
        make_runtime("onnx")
    monkeypatch.setattr(runtime, "find_spec", lambda name: None)
    assert make_runtime("auto") is in_torch
    with pytest.raises(UsageError, match=r"pip install 'gsedit\[openvino\]'"):
        make_runtime("openvino")
