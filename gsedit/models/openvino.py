"""Networks computed by OpenVINO: traced once, compiled for the processor, kept in the cache.

The arithmetic is float32; bfloat16 inside torch.autocast, and for weights in bfloat16.
"""

from __future__ import annotations

import copy
import hashlib
import inspect
import sys
import time
import warnings
import weakref
from collections import OrderedDict
from collections.abc import Callable, Sequence
from functools import partial
from math import ceil
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import torch
from torch import Tensor
from torch.utils._python_dispatch import _disable_current_modes

from gsedit.diffusion.memory import GB, free_bytes
from gsedit.diffusion.precision import MAX_ERROR, relative_error
from gsedit.errors import GseditError
from gsedit.models import graphs
from gsedit.models.runtime import Forward, Runtime
from gsedit.runs.environment import installed_version

ROWS = 4
"""Most rows in one call: more hardly compute faster (the weights are read once a call), and each
number of rows would be compiled."""
COMPILED = 4
"""Most compiled networks: denoiser, encoder, decoder, and one more size of picture."""
LEAST_WEIGHTS = 10_000_000
"""Weights below which `Faster` leaves a network to torch: tracing it would not pay."""
MAX_ERROR_FLOAT32 = 1e-3
"""Relative RMS error up to which `Faster` takes float32 of OpenVINO; it has 4e-6."""


class Compiled(NamedTuple):
    """A function compiled for one shape of inputs."""

    call: Callable[[list[Any]], Any]
    network: weakref.ref[Any]


class OpenVino:
    """A Runtime. Inputs with one leading dimension are computed a few rows at a time, always as
    many: missing rows are filled up. What needs gradients is left to torch. No network is kept
    alive, and what was compiled for one goes with it."""

    def __init__(self) -> None:
        self._compiled: OrderedDict[tuple[Any, ...], Compiled] = OrderedDict()
        self._rows: WeakKeyDictionary[Any, dict[tuple[Any, ...], int]] = WeakKeyDictionary()
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
        shapes = tuple((tuple(each.shape), each.dtype) for each in inputs)
        place, precision = (forward, id(network), shapes), _precision(network)
        threads = torch.get_num_threads()
        key = (*place, precision, threads)
        found = self._compiled.get(key)
        if found is None or found.network() is not network:  # an id may be given again
            for other in [each for each in self._compiled if each[:3] == place]:
                del self._compiled[other]  # the same in another precision: its weights take memory
            while len(self._compiled) >= COMPILED:
                self._compiled.popitem(last=False)
            try:
                graph = self._graph(forward, network, inputs, precision)
                gone = weakref.ref(network, partial(_forget, self._compiled, key))
                self._compiled[key] = Compiled(_compiled(graph, precision, threads), gone)
            except GseditError:
                raise
            except Exception as error:  # tracing runs the network; OpenVINO has errors of its own
                reason = " ".join(str(error).split())[:80]
                raise GseditError(
                    f"OpenVINO cannot compute {type(network).__name__} ({reason}): "
                    "add --runtime torch"
                ) from error
        self._compiled.move_to_end(key)
        (out,) = self._compiled[key].call([each.contiguous().numpy() for each in inputs]).values()
        return torch.from_numpy(out.copy())

    def _graph(self, forward: Forward, network: Any, inputs: list[Tensor], precision: str) -> Any:
        """The graph of the cache, or a new one, which is kept there."""
        openvino, key = _library(), self._key(forward, network, inputs, precision)
        if found := graphs.find(key):
            return openvino.Core().read_model(found)
        made = _traced(forward, network, inputs)
        half = precision == "bf16"  # float16 has more digits than bfloat16
        size = sum(each.numel() for each in network.parameters()) * (2 if half else 4)
        kept = graphs.keep(
            key, size, lambda path: openvino.save_model(made, path, compress_to_fp16=half)
        )
        return made if kept is None else openvino.Core().read_model(kept)

    def _key(self, forward: Forward, network: Any, inputs: list[Tensor], precision: str) -> str:
        """A name that changes with everything that a graph depends on."""
        if network not in self._digests:
            self._digests[network] = graphs.weights_digest(network.state_dict().items())
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

    def __init__(self, openvino: Runtime) -> None:
        self.openvino = openvino
        self.chosen: WeakKeyDictionary[Any, dict[tuple[Any, ...], str]] = WeakKeyDictionary()
        """Reason for the choice, of each network, by function, precision and shapes of the inputs'
        rows; it begins with the name of the runtime."""

    def __call__(self, forward: Forward, network: Any, *inputs: Tensor) -> Tensor:
        """The result of the function; the first time both compute it."""
        weights = sum(each.numel() for each in network.parameters())
        if weights < LEAST_WEIGHTS or (torch.is_grad_enabled() and inputs[0].requires_grad):
            return forward(network, *inputs)
        key = (forward, _precision(network), *_row_shapes(inputs))
        chosen = self.chosen.setdefault(network, {})
        if key not in chosen:
            chosen[key] = self._measured(forward, network, inputs)
        if chosen[key].startswith("openvino"):
            try:
                return self.openvino(forward, network, *inputs)
            except (GseditError, MemoryError) as error:  # compiled anew, and there is no room now
                chosen[key] = f"torch: {str(error)[:200]}"
        return forward(network, *inputs)

    def _measured(self, forward: Forward, network: Any, inputs: tuple[Tensor, ...]) -> str:
        """Compare both on other numbers than those that were traced: none may have become fixed."""
        other = [0.9 * each if each.is_floating_point() else each for each in inputs]
        try:
            self.openvino(forward, network, *inputs)  # traced and compiled
        except (GseditError, MemoryError) as error:
            return f"torch: {str(error)[:200]}"
        with torch.autocast("cpu", enabled=False):
            started = _seconds()
            exact = forward(network, *other)
            seconds = _seconds() - started
        limit = MAX_ERROR_FLOAT32
        if _precision(network) == "bf16":
            limit, started = MAX_ERROR, _seconds()
            forward(network, *other)
            seconds = _seconds() - started
        started = _seconds()
        found = self.openvino(forward, network, *other)
        own = _seconds() - started
        error = relative_error(found, exact)
        name = "openvino" if own < seconds and error <= limit else "torch"
        return f"{name}: openvino takes {own:.2g} s, torch {seconds:.2g} s; error {error:.1g}"


def _row_shapes(inputs: Sequence[Tensor]) -> tuple[tuple[int, ...], ...]:
    return tuple(tuple(each.shape[1:]) for each in inputs)


def _forget(compiled: OrderedDict[tuple[Any, ...], Compiled], key: Any, gone: Any) -> None:
    """Drop what was compiled for a network that is gone."""
    if key in compiled and compiled[key].network is gone:
        del compiled[key]


def _library() -> Any:
    """OpenVINO, without the telemetry that it would send over the network."""
    sys.modules.setdefault("openvino_telemetry", None)  # pyright: ignore[reportArgumentType]
    import openvino

    return openvino


def _seconds() -> float:
    """Processor time of all threads: other programs must not decide."""
    return time.process_time()


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
    dtypes = {each.dtype for each in network.parameters() if each.is_floating_point()}
    _check_memory(network, copies=2 if dtypes - {torch.float32} else 1)
    if dtypes - {torch.float32}:
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


def _check_memory(network: Any, copies: int) -> None:
    """Raise GseditError where so many copies of the weights in float32 do not fit into memory."""
    needed = 4 * copies * sum(each.numel() for each in network.parameters())
    if needed > free_bytes():
        raise GseditError(
            f"OpenVINO takes {needed / GB:.1f} GB to trace {type(network).__name__}, and "
            f"{free_bytes() / GB:.1f} GB are free: add --runtime torch"
        )


def _compiled(graph: Any, precision: str, threads: int) -> Callable[[list[Any]], Any]:
    options = {
        "INFERENCE_PRECISION_HINT": precision, "INFERENCE_NUM_THREADS": threads,
        "PERFORMANCE_HINT": "LATENCY", "NUM_STREAMS": 1,
    }  # fmt: skip
    return _library().Core().compile_model(graph, "CPU", options)
