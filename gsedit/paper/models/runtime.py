"""Who computes a model's networks: torch, or OpenVINO where it is faster and right.

OpenVINO traces a function once, compiles it for the processor, and keeps the graph in the user's
cache folder. Its arithmetic is float32; bfloat16 inside torch.autocast, and for weights in it.
"""

from __future__ import annotations

import copy
import hashlib
import inspect
import os
import shutil
import sys
import tempfile
import time
import warnings
from collections import OrderedDict
from collections.abc import Callable, Sequence
from contextlib import suppress
from importlib.util import find_spec
from math import ceil
from pathlib import Path
from typing import Any, Protocol, runtime_checkable
from weakref import WeakKeyDictionary

import torch
from torch import Tensor
from torch.utils._python_dispatch import _disable_current_modes

from gsedit.errors import GseditError, UsageError
from gsedit.paper.diffusion.precision import GB, MAX_ERROR, free_bytes, relative_error
from gsedit.run.environment import installed_version
from rasterizer.compiled import cache_folder

ROWS = 4
"""Most rows in one call: more hardly compute faster (the weights are read once a call), and each
number of rows would be compiled."""
COMPILED = 2
"""Most compiled functions of a network: an encoder and a decoder, or two sizes of picture."""
LEAST_WEIGHTS = 10_000_000
"""Weights below which `Faster` leaves a network to torch: tracing it would not pay."""
MAX_ERROR_FLOAT32 = 1e-3
"""Relative RMS error up to which `Faster` takes float32 of OpenVINO; it has 4e-6."""
MOST_BYTES = 24_000_000_000
"""Largest cache of graphs: two networks of 2.6 billion weights (SDXL) in float32."""

Forward = Callable[..., Tensor]
"""(network, tensors...) -> tensor: a module-level function, with no other inputs or state."""


@runtime_checkable
class Runtime(Protocol):
    """Computes a network's forward function, in torch or in another library.

    A runtime may trace `forward` once for each shape of the inputs, so it must not branch on their
    values. Where all inputs have the same leading dimension, its rows must not influence each
    other: a runtime may compute some at a time.
    """

    def __call__(self, forward: Forward, network: Any, *inputs: Tensor) -> Tensor:
        """The result of `forward(network, *inputs)`."""
        ...


def in_torch(forward: Forward, network: Any, *inputs: Tensor) -> Tensor:
    """The Runtime that calls the function."""
    return forward(network, *inputs)


def make_runtime(name: str) -> Runtime:
    """The runtime of that name; auto is torch where openvino is not installed.

    Raises UsageError for another name, and for openvino where it is not installed.
    """
    installed = find_spec("openvino") is not None
    if name not in ("torch", "openvino", "auto"):
        raise UsageError(f"--runtime must be torch, openvino or auto, not {name!r}")
    if name == "openvino" and not installed:
        raise UsageError("--runtime openvino needs openvino: pip install 'gsedit[openvino]'")
    if name == "torch" or not installed:
        return in_torch
    return OpenVino() if name == "openvino" else Faster(OpenVino())


class OpenVino:
    """A Runtime. Inputs with one leading dimension are computed a few rows at a time, always as
    many: missing rows are filled up. What needs gradients is left to torch. No network is kept
    alive, and what was compiled for one goes with it."""

    def __init__(self) -> None:
        self._compiled: WeakKeyDictionary[Any, OrderedDict[Any, Any]] = WeakKeyDictionary()
        self._rows: WeakKeyDictionary[Any, dict[Any, int]] = WeakKeyDictionary()
        self._digests: WeakKeyDictionary[Any, str] = WeakKeyDictionary()

    def __call__(self, forward: Forward, network: Any, *inputs: Tensor) -> Tensor:
        """The result of the function, in the dtype of the first input."""
        if torch.is_grad_enabled() and any(each.requires_grad for each in inputs):
            return forward(network, *inputs)
        given = [each.detach().float() if each.is_floating_point() else each for each in inputs]
        counts = {each.shape[0] if each.ndim else 0 for each in given}
        if len(counts) > 1 or counts == {0}:
            out = self._run(forward, network, given)
        else:
            out = self._in_parts(forward, network, given, *counts)
        return out.to(inputs[0].dtype)

    def _in_parts(self, forward: Forward, network: Any, inputs: list[Tensor], count: int) -> Tensor:
        """The result of all rows, computed so many at a time as the first time."""
        kind = (forward, *_row_shapes(inputs))
        rows = self._rows.setdefault(network, {}).setdefault(kind, ceil(count / ceil(count / ROWS)))
        parts = []
        for first in range(0, count, rows):
            part = [each[first : first + rows] for each in inputs]
            missing = rows - len(part[0])
            full = [torch.cat((each, each[-1:].repeat_interleave(missing, 0))) for each in part]
            parts.append(self._run(forward, network, full)[: rows - missing])
        return torch.cat(parts)

    def _run(self, forward: Forward, network: Any, inputs: list[Tensor]) -> Tensor:
        shapes, precision = [(tuple(x.shape), x.dtype) for x in inputs], _precision(network)
        key = (precision, torch.get_num_threads(), forward, *shapes)
        known = self._compiled.setdefault(network, OrderedDict())
        if key not in known:
            for other in [each for each in known if each[0] != precision]:
                del known[other]  # the same weights in another precision take memory
            while len(known) >= COMPILED:
                known.popitem(last=False)
            try:
                graph = self._graph(forward, network, inputs, precision)
                known[key] = _compiled(graph, *key[:2])
            except GseditError:
                raise
            except Exception as error:  # tracing runs the network; OpenVINO has errors of its own
                reason = " ".join(str(error).split())[:80]
                raise GseditError(
                    f"OpenVINO cannot compute {type(network).__name__} ({reason}): "
                    "add --runtime torch"
                ) from error
        known.move_to_end(key)
        (out,) = known[key]([each.contiguous().numpy() for each in inputs]).values()
        return torch.from_numpy(out.copy())

    def _graph(self, forward: Forward, network: Any, inputs: list[Tensor], precision: str) -> Any:
        """The graph of the cache, or a new one, which is kept there where it can be."""
        openvino, key = _library(), self._key(forward, network, inputs, precision)
        with suppress(OSError, RuntimeError):  # none, or a damaged one
            graph = openvino.Core().read_model(graphs_folder() / key / "graph.xml")
            os.utime(graphs_folder() / key)  # used now
            return graph
        made = _traced(forward, network, inputs)
        half = precision == "bf16"  # float16 has more digits than bfloat16
        size = sum(each.numel() for each in network.parameters()) * (2 if half else 4)
        with suppress(OSError, RuntimeError):  # a full disk: it is traced again the next time
            return openvino.Core().read_model(
                keep(key, size, lambda path: openvino.save_model(made, path, compress_to_fp16=half))
            )
        return made

    def _key(self, forward: Forward, network: Any, inputs: list[Tensor], precision: str) -> str:
        """A name that changes with everything that a graph depends on."""
        if network not in self._digests:
            digest = hashlib.sha1(usedforsecurity=False)  # the fastest here: 1.5 GB/s
            for name, tensor in network.state_dict().items():
                digest.update(f"{name} {tensor.dtype} {tuple(tensor.shape)}".encode())
                digest.update(tensor.contiguous().view(-1).view(torch.uint8).numpy().data)
            self._digests[network] = digest.hexdigest()
        parts = (
            forward.__module__, forward.__qualname__, _code(forward), type(network).__qualname__,
            sorted((k, str(v)) for k, v in dict(getattr(network, "config", {})).items()),
            self._digests[network], [(tuple(x.shape), str(x.dtype)) for x in inputs],
            precision, *map(installed_version, ("gsedit", "openvino", "torch", "diffusers")),
        )  # fmt: skip
        return hashlib.sha256(repr(parts).encode()).hexdigest()[:32]


class Faster:
    """A Runtime: OpenVINO where it was faster than torch and right, measured at a network's first
    call with rows of a shape; torch elsewhere."""

    def __init__(self, openvino: Runtime, least_weights: int = LEAST_WEIGHTS) -> None:
        self.openvino, self.least_weights = openvino, least_weights
        self.chosen: WeakKeyDictionary[Any, dict[tuple[Any, ...], str]] = WeakKeyDictionary()
        """Reason for the choice, of each network, by function, precision and shapes of the inputs'
        rows; it begins with the name of the runtime."""

    def __call__(self, forward: Forward, network: Any, *inputs: Tensor) -> Tensor:
        """The result of the function; the first time both compute it."""
        weights = sum(each.numel() for each in network.parameters())
        if weights < self.least_weights or (torch.is_grad_enabled() and inputs[0].requires_grad):
            return forward(network, *inputs)
        key = (forward, _precision(network), *_row_shapes(inputs))
        chosen = self.chosen.setdefault(network, {})
        try:
            if key not in chosen:
                chosen[key] = self._measured(forward, network, inputs)
            if chosen[key].startswith("openvino"):
                return self.openvino(forward, network, *inputs)
        except (GseditError, MemoryError) as error:  # also where it is compiled anew, without room
            chosen[key] = f"torch: {str(error)[:200]}"
        return forward(network, *inputs)

    def _measured(self, forward: Forward, network: Any, inputs: tuple[Tensor, ...]) -> str:
        """Compare both on other numbers than those that were traced: none may have become fixed."""
        other = [0.9 * each if each.is_floating_point() else each for each in inputs]
        self.openvino(forward, network, *inputs)  # traced and compiled
        with torch.autocast("cpu", enabled=False):
            exact, seconds = _timed(in_torch, forward, network, *other)
        limit = MAX_ERROR_FLOAT32
        if _precision(network) == "bf16":
            limit, (_, seconds) = MAX_ERROR, _timed(in_torch, forward, network, *other)
        found, own = _timed(self.openvino, forward, network, *other)
        error = relative_error(found, exact)
        name = "openvino" if own < seconds and error <= limit else "torch"
        return f"{name}: openvino takes {own:.2g} s, torch {seconds:.2g} s; error {error:.1g}"


# ---- graphs on the disk --------------------------------------------------------------------------


def graphs_folder() -> Path:
    """`openvino` in gsedit's cache folder. Raises OSError where there is no such place."""
    return cache_folder() / "openvino"


def cached_bytes(folder: Path | None = None) -> int:
    """Size of all graphs in the cache, or of the files of one; 0 where there is none."""
    with suppress(OSError):
        files = (folder or graphs_folder()).rglob("*")
        return sum(file.stat().st_size for file in files if file.is_file())
    return 0


def keep(key: str, size: int, write: Callable[[Path], None]) -> Path:
    """Write a graph of about `size` bytes (`write` is given the path of graph.xml), whole or not at
    all, in the place of the longest unused ones. Raises OSError where it does not fit."""
    folder = graphs_folder()
    folder.mkdir(mode=0o700, exist_ok=True)
    for graph in sorted(folder.iterdir(), key=lambda each: each.stat().st_mtime):
        if cached_bytes() + size > MOST_BYTES:
            shutil.rmtree(graph, ignore_errors=True)
    # a cache must not fill a disk
    if size > MOST_BYTES or 2 * size > shutil.disk_usage(folder).free:
        raise OSError("there is no room for it")
    begun = Path(tempfile.mkdtemp(prefix=".begun-", dir=folder))
    try:
        write(begun / "graph.xml")
        shutil.rmtree(folder / key, ignore_errors=True)
        begun.rename(folder / key)
    finally:
        shutil.rmtree(begun, ignore_errors=True)
    return folder / key / "graph.xml"


# ---- tracing and compiling -----------------------------------------------------------------------


def _row_shapes(inputs: Sequence[Tensor]) -> tuple[tuple[int, ...], ...]:
    return tuple(tuple(each.shape[1:]) for each in inputs)


def _library() -> Any:
    """OpenVINO, without the telemetry that it would send over the network."""
    sys.modules.setdefault("openvino_telemetry", None)  # pyright: ignore[reportArgumentType]
    import openvino

    return openvino


def _seconds() -> float:
    """Processor time of all threads: other programs must not decide."""
    return time.process_time()


def _timed(run: Runtime, *given: Any) -> tuple[Tensor, float]:
    """(result, seconds that it took)."""
    started = _seconds()
    return run(*given), _seconds() - started


def _code(forward: Forward) -> str:
    """The source of the function's module: another version of gsedit may compute otherwise."""
    try:
        return inspect.getsource(sys.modules[forward.__module__])
    except (OSError, TypeError):  # without sources, versions alone tell
        return ""


def _precision(network: Any) -> str:
    """Arithmetic that torch would use, by OpenVINO's name."""
    dtype = next((each.dtype for each in network.parameters()), torch.float32)
    rounded = torch.is_autocast_enabled("cpu") or dtype == torch.bfloat16
    return "bf16" if rounded else "f32"


class _Traced(torch.nn.Module):
    """The function as a module, which tracing needs."""

    def __init__(self, function: Forward, network: Any) -> None:
        super().__init__()
        self.function, self.network = function, network

    def forward(self, *inputs: Tensor) -> Tensor:
        return self.function(self.network, *inputs)


def _traced(forward: Forward, network: Any, inputs: list[Tensor]) -> Any:
    """The graph of a function. Raises GseditError where the weights, twice where they are not in
    float32, do not fit into memory."""
    is_half = {each.dtype for each in network.parameters() if each.is_floating_point()} - {
        torch.float32
    }
    needed = (8 if is_half else 4) * sum(each.numel() for each in network.parameters())
    if needed > free_bytes():
        raise GseditError(
            f"OpenVINO takes {needed / GB:.1f} GB to trace {type(network).__name__}, and "
            f"{free_bytes() / GB:.1f} GB are free: add --runtime torch"
        )
    if is_half:
        network = copy.deepcopy(network).float()  # 16-bit graphs lack operations
    module = _Traced(forward, network).eval()
    shapes = [tuple(each.shape) for each in inputs]
    with (
        warnings.catch_warnings(),
        torch.no_grad(),
        torch.autocast("cpu", enabled=False),
        _disable_current_modes(),  # whoever counts memory hides the tensors from the trace
    ):
        warnings.simplefilter("ignore")  # shapes become constants: that is wanted
        return _library().convert_model(module, example_input=tuple(inputs), input=shapes)


def _compiled(graph: Any, precision: str, threads: int) -> Callable[[list[Any]], Any]:
    options = {
        "INFERENCE_PRECISION_HINT": precision, "INFERENCE_NUM_THREADS": threads,
        "PERFORMANCE_HINT": "LATENCY", "NUM_STREAMS": 1,
    }  # fmt: skip
    return _library().Core().compile_model(graph, "CPU", options)
