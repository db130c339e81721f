"""Work that can go on where it stopped, as one file: tensors, and everything else as JSON.

The file is safetensors (nothing in it is executed); the JSON is in its metadata, so that the two
always belong together.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from torch import Tensor

from gsedit.errors import InputError, Said, UsageError
from gsedit.run.atomic import atomic_path
from gsedit.run.inputs import existing_file
from gsedit.run.json_files import Check, Misfit, list_of, number, object_of, parse_json, text

KEY = "gsedit"
"""Key of the JSON in the file's metadata."""
FORMAT = 2
"""Version of the record: raised when older states can no longer be read."""


def _flag(value: Any, place: str) -> bool:
    if not isinstance(value, bool):
        raise Misfit(f"{place} is neither true nor false")
    return value


def _source(value: Any, place: str) -> Any:
    """Check that it is nothing, or where a scene is and whether invalid rows are dropped."""
    return object_of({"scene": text(), "drop_invalid": _flag} if value != {} else {})(value, place)


def _or_none(check: Check) -> Check:
    return lambda value, place: value if value is None else check(value, place)


_OBJECT, _LIST = object_of({}), list_of(lambda value, place: value)
_COUNT, _DURATION = number(0, whole=True), number(0, 1e9)  # 32 years
_CHECKS: Mapping[str, Check] = {
    **dict.fromkeys(("request", "command", "view_plan", "work", "stages"), _OBJECT),
    **dict.fromkeys(("answers", "targets", "pairs", "order", "curve"), _LIST),
    **dict.fromkeys(
        ("step", "undone", "noise_seed", "started_with", "threads", "edit_format"), _COUNT
    ),
    **dict.fromkeys(("seconds", "next_evaluation", "last_checkpoint"), _DURATION),
    "events": list_of(_OBJECT),
    "source": _source,
    "loss": _or_none(number()),
    "region": _or_none(text(empty=True)),
    "voted": _flag,
}
"""Checks of a record's values, for those that are there."""


@dataclass(frozen=True, eq=False)
class State:
    """State of unfinished work: tensors and a record."""

    record: Mapping[str, Any]
    """Values that JSON can hold; NaN and infinity too, as Python writes them."""
    tensors: Mapping[str, Tensor]
    """By name. They may be the work's own memory: write them before the work goes on."""
    source: str = "the checkpoint"
    """Path of the file that it was read from, for messages."""

    def along_with(self, **more: Any) -> State:
        """The state with more in its record."""
        return replace(self, record={**self.record, **more})

    def within(self, prefix: str) -> dict[str, Tensor]:
        """The tensors whose name begins with `prefix` and a point, by the rest of the name."""
        start = f"{prefix}."
        return {k.removeprefix(start): v for k, v in self.tensors.items() if k.startswith(start)}


def save_state(state: State, path: Path) -> None:
    """Write or replace the file, whole or not at all. Raises what `atomic_path` raises."""
    from safetensors import SafetensorError
    from safetensors.torch import save_file

    written = json.dumps({"format": FORMAT, **state.record})
    tensors = {name: each.detach().cpu().contiguous() for name, each in state.tensors.items()}
    with atomic_path(path, overwrite=True) as temporary:
        try:
            save_file(tensors, temporary, metadata={KEY: written})
        except SafetensorError as error:  # a full disk too
            raise OSError(str(error)) from error


def load_state(path: Path) -> State:
    """The state of a file. Raises InputError for one that is none, or of another version."""
    from safetensors import SafetensorError, safe_open

    existing_file(path)
    try:
        with safe_open(path, framework="pt") as file:
            written = (file.metadata() or {})[KEY]
            record = parse_json(written, path, object_of({}), advice="remove it, and start again")
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except (SafetensorError, KeyError, ValueError) as error:
        raise InputError(
            f"{path} is no checkpoint of gsedit ({error}): remove it, and start the work again"
        ) from None
    if record.get("format") != FORMAT:
        raise InputError(
            f"{path} was written by another version of gsedit: go on with that version, or remove "
            "it and start again"
        )
    try:
        for name in _CHECKS.keys() & record.keys():
            _CHECKS[name](record[name], name)
    except Misfit as error:
        raise InputError(
            f"{path} is damaged ({error}): remove it, and start the work again"
        ) from None
    return State(record, tensors, str(path))


@contextmanager
def restoring(state: State) -> Iterator[None]:
    """Raise InputError, with the file, for what a state lacks that the work goes on from."""
    try:
        yield
    except (
        KeyError, TypeError, ValueError, IndexError, AttributeError, OverflowError, RecursionError
    ) as error:  # fmt: skip
        raise InputError(
            f"{state.source} is damaged, or of other work ({type(error).__name__}: {error}): "
            "remove it, and start the work again"
        ) from None


def tensor_like(tensors: Mapping[str, Tensor], name: str, like: Tensor) -> Tensor:
    """Return a copy of a tensor of a state. Raises ValueError unless it has the shape and dtype of
    `like` and is finite."""
    found = tensors.get(name)
    if found is None or (found.shape, found.dtype) != (like.shape, like.dtype):
        raise ValueError(f"the state has no {name} of shape {tuple(like.shape)}, {like.dtype}")
    if found.is_floating_point() and not found.isfinite().all():
        raise ValueError(f"{name} is not finite")
    return found.detach().clone()


def digest_of(tensors: Iterable[Tensor]) -> str:
    """A short text that is another for other numbers; tensors need not be there at once."""
    total = hashlib.sha256()
    for tensor in tensors:
        total.update(f"{tensor.dtype}{tuple(tensor.shape)}".encode())
        if tensor.numel():
            total.update(tensor.detach().cpu().contiguous().numpy().data.cast("B"))
    return total.hexdigest()[:16]


def check_same(now: Mapping[str, Any], before: Mapping[str, Any], work: str) -> None:
    """Raise UsageError that names what differs, unless both records (as JSON has them) ask for the
    same. `work`: "edit" or "fit"."""
    new, old = dict(_flat(now)), dict(_flat(before))
    different = [
        f"{name} is {new.get(name)}, was {old.get(name)}"
        for name in dict.fromkeys((*old, *new))
        if new.get(name) != old.get(name)
    ]
    if different:
        what = f"this is not the {work} that was interrupted: {'; '.join(different)}"
        raise UsageError(Said(what, "repeat"))


def _flat(record: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    """The values of nested records, by names such as settings.update.patches."""
    for name, value in record.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{above}{name}.")
        else:
            yield f"{above}{name}", value
