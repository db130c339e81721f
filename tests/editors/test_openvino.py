"""Networks computed by OpenVINO: equal to torch's, kept on disk, and chosen only where better."""

from __future__ import annotations

import gc
import os
import weakref
from importlib.util import find_spec

import pytest
import torch
from closeness import NETWORK, assert_near
from tiny_models import tiny_unet, tiny_vae

from gsedit.diffusion.memory import peak_bytes
from gsedit.errors import GseditError, UsageError
from gsedit.models import autoencoder, graphs, runtimes
from gsedit.models.runtime import in_torch
from gsedit.models.runtimes import make_runtime
from gsedit.models.stable_diffusion import _predicted

if find_spec("openvino") is None:  # importing it here would start its telemetry, in processes
    pytest.skip("needs gsedit[openvino]", allow_module_level=True)

from gsedit.models import openvino

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
    run, traced = openvino.OpenVino(), []
    whole = openvino._traced
    monkeypatch.setattr(openvino, "_traced", lambda *a: traced.append(a) or whole(*a))
    for rows in (3, 9, 1, 5):
        given = inputs(rows)
        close(run(_predicted, unet, *given), in_torch(_predicted, unet, *given))
    assert len(traced) == 1


def test_autoencoder_is_equal_to_torch():
    with torch.random.fork_rng():
        torch.manual_seed(0)
        vae = tiny_vae().eval().requires_grad_(False)
    latents = torch.randn(2, 4, 4, 4, generator=torch.Generator().manual_seed(0))
    found = autoencoder.decoded(openvino.OpenVino(), vae, latents, 1)
    close(found, autoencoder.decoded(in_torch, vae, latents, 1))


def test_a_network_is_traced_while_its_memory_is_counted():
    layer, x = torch.nn.Linear(4, 4).requires_grad_(False), torch.ones(2, 4)
    run, found = openvino.OpenVino(), []
    peak_bytes(lambda: found.append(run(linear, layer, x)))
    close(found[0], layer(x))


def test_what_cannot_be_traced_is_told_in_one_line():
    def fails(network, x):
        raise RuntimeError("no\nsuch operation")

    layer = torch.nn.Linear(4, 4).requires_grad_(False)
    with pytest.raises(GseditError, match="--runtime torch"):
        openvino.OpenVino()(fails, layer, torch.ones(1, 4))


def test_gradients_go_through_torch():
    layer = torch.nn.Linear(4, 4)
    x = torch.ones(1, 4, requires_grad=True)
    openvino.OpenVino()(linear, layer, x).sum().backward()
    assert x.grad is not None


def test_second_start_reads_the_graph_and_a_damaged_one_is_made_again(cache, monkeypatch):
    layer, x = torch.nn.Linear(4, 4).requires_grad_(False), torch.ones(2, 4)
    expected = layer(x)
    close(openvino.OpenVino()(linear, layer, x), expected)
    (graph,) = cache.iterdir()
    assert graphs.cached_bytes() > 0
    with monkeypatch.context() as patch:
        patch.setattr(openvino, "_traced", None)  # it would raise
        close(openvino.OpenVino()(linear, layer, x), expected)
    weights = graph / "graph.bin"
    weights.write_bytes(bytes(weights.stat().st_size))
    close(openvino.OpenVino()(linear, layer, x), expected)
    assert [each.name for each in cache.iterdir()] == [graph.name]
    assert any(weights.read_bytes())


def test_other_weights_and_another_shape_have_a_graph_of_their_own(cache):
    layer = torch.nn.Linear(4, 4).requires_grad_(False)
    for x in (torch.ones(2, 4), torch.ones(2, 3, 4)):
        close(openvino.OpenVino()(linear, layer, x), layer(x))
    layer.weight[0, 0] += 1
    close(openvino.OpenVino()(linear, layer, torch.ones(2, 4)), layer(torch.ones(2, 4)))
    assert len(list(cache.iterdir())) == 3


def test_the_cache_is_bounded_and_the_longest_unused_goes(cache, monkeypatch):
    monkeypatch.setattr(graphs, "MOST_BYTES", 1000)

    def write(path):
        path.write_bytes(bytes(100))
        path.with_name("graph.bin").write_bytes(bytes(300))

    ages = []
    for name in ("a", "b"):
        assert graphs.keep(name, 400, write) is not None
        ages.append((cache / name / "whole.json").stat().st_mtime_ns)
    assert ages == sorted(ages)
    assert graphs.keep("c", 400, write) is not None
    assert sorted(each.name for each in cache.iterdir()) == ["b", "c"]
    assert graphs.keep("huge", 2000, write) is None


@REAL_PROCESSOR
def test_bfloat16_where_torch_would_take_it():
    layer = torch.nn.Linear(64, 64).requires_grad_(False)
    x = torch.randn(2, 64, generator=torch.Generator().manual_seed(0))
    with torch.autocast("cpu", dtype=torch.bfloat16):
        rounded = openvino.OpenVino()(linear, layer, x)
    assert rounded.dtype == torch.float32
    assert (rounded - layer(x)).norm() / layer(x).norm() < 0.02


@REAL_PROCESSOR
def test_weights_in_16_bits_are_traced_in_32():
    half = torch.nn.Sequential(torch.nn.Conv2d(4, 8, 3), torch.nn.GroupNorm(2, 8))
    half, x = half.bfloat16().requires_grad_(False), torch.ones(1, 4, 8, 8).bfloat16()
    found = openvino.OpenVino()(linear, half, x)
    assert found.dtype == next(half.parameters()).dtype == torch.bfloat16
    assert (found.float() - half.float()(x.float())).norm() < 0.02 * found.float().norm() + 0.01


@pytest.mark.parametrize(("error", "expected"), [(0.0, "openvino"), (0.1, "torch")])
def test_auto_takes_what_is_faster_and_right(monkeypatch, error, expected):
    layer, x = torch.nn.Linear(4, 4).requires_grad_(False), torch.ones(2, 4)
    clock = iter([0.0, 5.0, 5.0, 6.0])  # torch 5 s, OpenVINO 1 s
    monkeypatch.setattr(openvino, "_seconds", lambda: next(clock))
    monkeypatch.setattr(openvino, "LEAST_WEIGHTS", 0)

    def fake(forward, network, *given):
        return forward(network, *given) * (1 + error)

    run = openvino.Faster(fake)
    run(linear, layer, x)
    close(run(linear, layer, x), layer(x))
    (reason,) = run.chosen[layer].values()
    assert reason.startswith(expected)


def fixed(network: torch.nn.Module, x: torch.Tensor) -> torch.Tensor:
    return network(x) * float(x.sum())  # a number of the first input becomes a constant


def test_auto_notices_a_number_that_tracing_fixed(monkeypatch):
    monkeypatch.setattr(openvino, "LEAST_WEIGHTS", 0)
    layer, x = torch.nn.Linear(4, 4).requires_grad_(False), torch.ones(2, 4)
    run = openvino.Faster(openvino.OpenVino())
    for factor in (1.0, 3.0):
        close(run(fixed, layer, factor * x), fixed(layer, factor * x))
    (reason,) = run.chosen[layer].values()
    assert reason.startswith("torch")


def test_auto_leaves_to_torch_what_does_not_fit_into_memory(monkeypatch):
    monkeypatch.setattr(openvino, "LEAST_WEIGHTS", 0)
    monkeypatch.setattr(openvino, "free_bytes", lambda: 10)
    layer, x = torch.nn.Linear(4, 4).requires_grad_(False), torch.ones(2, 4)
    run = openvino.Faster(openvino.OpenVino())
    close(run(linear, layer, x), layer(x))
    with pytest.raises(GseditError, match="GB are free: add --runtime torch"):
        run.openvino(linear, layer, x)


def test_auto_decides_for_each_shape_of_rows(monkeypatch):
    monkeypatch.setattr(openvino, "LEAST_WEIGHTS", 0)
    monkeypatch.setattr(openvino, "_seconds", iter([0.0, 5.0, 5.0, 6.0]).__next__)
    layer = torch.nn.Linear(4, 4).requires_grad_(False)

    def small_only(forward, network, x):
        if x.ndim > 2:
            raise GseditError("memory")
        return forward(network, x)

    run, large = openvino.Faster(small_only), torch.ones(2, 3, 4)
    for x in (torch.ones(2, 4), large, torch.ones(5, 4)):
        close(run(linear, layer, x), layer(x))
    assert [each.partition(":")[0] for each in run.chosen[layer].values()] == ["openvino", "torch"]


def test_auto_goes_on_in_torch_where_memory_has_run_out(monkeypatch):
    monkeypatch.setattr(openvino, "LEAST_WEIGHTS", 0)
    layer, x = torch.nn.Linear(4, 4).requires_grad_(False), torch.ones(2, 4)

    def full(forward, network, x):
        raise GseditError("memory")

    run = openvino.Faster(full)
    key = (linear, "f32", (4,))
    run.chosen[layer] = {key: "openvino: faster"}
    close(run(linear, layer, x), layer(x))
    assert run.chosen[layer][key].startswith("torch")


def test_networks_are_not_kept_alive_and_what_was_compiled_goes_with_them():
    run, faster = openvino.OpenVino(), openvino.Faster(in_torch)
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


def test_graphs_of_another_version_of_the_code_are_not_read(cache, monkeypatch):
    layer, x = torch.nn.Linear(4, 4).requires_grad_(False), torch.ones(2, 4)
    openvino.OpenVino()(linear, layer, x)
    monkeypatch.setattr(openvino, "_code", lambda forward: "changed")
    openvino.OpenVino()(linear, layer, x)
    assert len(list(cache.iterdir())) == 2


@pytest.mark.parametrize("record", ["{}", "[]", "null"])
def test_a_graph_without_its_checksums_is_removed(cache, record):
    (cache / "key").mkdir(parents=True)
    (cache / "key" / "whole.json").write_text(record)
    assert graphs.find("key") is None
    assert not (cache / "key").exists()


def test_runtimes_by_name(monkeypatch):
    assert make_runtime("torch") is in_torch
    assert isinstance(make_runtime("auto"), openvino.Faster)
    with pytest.raises(UsageError, match="torch, openvino or auto"):
        make_runtime("onnx")
    monkeypatch.setattr(runtimes, "find_spec", lambda name: None)
    assert make_runtime("auto") is in_torch
    with pytest.raises(UsageError, match=r"pip install 'gsedit\[openvino\]'"):
        make_runtime("openvino")
