"""Work that can go on where it stopped, as one file: tensors, and everything else as JSON.

The file is safetensors (nothing in it is executed); the JSON is in its metadata, so that the two
always belong together.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from torch import Tensor

from gsedit.errors import InputError, Said, UsageError
from gsedit.storage.atomic import atomic_path
from gsedit.storage.inputs import existing_file
from gsedit.storage.json_files import object_of, parse_json

KEY = "gsedit"
"""Key of the JSON in the file's metadata."""
FORMAT = 2
"""Version of the record: raised when older states can no longer be read."""
LONGEST_SECONDS = 1e9
"""Longest time that work may have taken: 32 years, which a plot still has an axis for."""


def _is_object(value: Any) -> bool:
    return isinstance(value, dict)


def _is_list(value: Any) -> bool:
    return isinstance(value, list)


def _is_count(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value >= 0


def _are_objects(value: Any) -> bool:
    return isinstance(value, list) and all(isinstance(each, dict) for each in value)


def _is_duration(value: Any) -> bool:
    return isinstance(value, int | float) and 0 <= value <= LONGEST_SECONDS


def _is_source(value: Any) -> bool:
    """Whether it is nothing, or where a scene is and whether invalid rows are dropped."""
    kinds = {"scene": str, "drop_invalid": bool}
    return value == {} or (
        isinstance(value, dict) and all(isinstance(value.get(k), t) for k, t in kinds.items())
    )


_KINDS: Mapping[str, Callable[[Any], bool]] = {
    **dict.fromkeys(("request", "command", "view_plan", "work", "stages"), _is_object),
    **dict.fromkeys(("answers", "targets", "pairs", "order", "curve"), _is_list),
    **dict.fromkeys(
        ("step", "undone", "noise_seed", "started_with", "threads", "edit_format"), _is_count
    ),
    **dict.fromkeys(("seconds", "next_evaluation", "last_checkpoint"), _is_duration),
    "events": _are_objects,
    "source": _is_source,
    "loss": lambda value: value is None or isinstance(value, int | float),
    "region": lambda value: value is None or isinstance(value, str),
    "voted": lambda value: isinstance(value, bool),
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

    text = json.dumps({"format": FORMAT, **state.record})
    tensors = {name: each.detach().cpu().contiguous() for name, each in state.tensors.items()}
    with atomic_path(path, overwrite=True) as temporary:
        try:
            save_file(tensors, temporary, metadata={KEY: text})
        except SafetensorError as error:  # a full disk too
            raise OSError(str(error)) from error


def load_state(path: Path) -> State:
    """The state of a file. Raises InputError for one that is none, or of another version."""
    from safetensors import SafetensorError, safe_open

    existing_file(path)
    try:
        with safe_open(path, framework="pt") as file:
            text = (file.metadata() or {})[KEY]
            record = parse_json(text, path, object_of({}), advice="remove it, and start again")
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
    wrong = [name for name, kind in _KINDS.items() if name in record and not kind(record[name])]
    if wrong:
        raise InputError(
            f"{path} is damaged ({', '.join(wrong)}): remove it, and start the work again"
        )
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


def digest(*tensors: Tensor) -> str:
    """A short text that is another for other numbers."""
    return digest_of(tensors)


def digest_of(tensors: Iterable[Tensor]) -> str:
    """`digest`, of tensors that need not be there at once."""
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
