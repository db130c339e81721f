"""Work that can go on where it stopped, as one file: tensors, and everything else as JSON.

The file is safetensors (nothing in it is executed); the JSON is in its metadata, so that the two
always belong together.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from torch import Tensor

from gsedit.errors import InputError, UsageError
from gsedit.files.atomic import atomic_path
from gsedit.files.inputs import existing_file

KEY = "gsedit"
"""Of the JSON in the metadata."""
FORMAT = 2
"""Of the record: raised when an older state can no longer be read."""


@dataclass(frozen=True, eq=False)
class State:
    """Where some work is."""

    record: Mapping[str, Any]
    """What JSON can hold; NaN and infinity too, as Python writes them."""
    tensors: Mapping[str, Tensor]
    """By name. They may be the work's own memory: write them before the work goes on."""

    def along_with(self, **more: Any) -> State:
        """The state with more in its record."""
        return replace(self, record={**self.record, **more})

    def within(self, prefix: str) -> dict[str, Tensor]:
        """The tensors whose name begins with `prefix` and a point, by the rest of the name."""
        start = f"{prefix}."
        return {k.removeprefix(start): v for k, v in self.tensors.items() if k.startswith(start)}


def save_state(state: State, path: Path) -> None:
    """Write or replace the file, whole or not at all. Raises UsageError where it cannot be."""
    from safetensors.torch import save_file

    text = json.dumps({"format": FORMAT, **state.record})
    tensors = {name: each.detach().cpu().contiguous() for name, each in state.tensors.items()}
    with atomic_path(path, overwrite=True) as temporary:
        save_file(tensors, temporary, metadata={KEY: text})


def load_state(path: Path) -> State:
    """The state of a file. Raises InputError for one that is none, or of another version."""
    from safetensors import SafetensorError, safe_open

    existing_file(path)
    try:
        with safe_open(path, framework="pt") as file:
            record = json.loads((file.metadata() or {})[KEY])
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
    return State(record, tensors)


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
        raise UsageError(
            f"this is not the {work} that was interrupted: {'; '.join(different)}. Repeat that "
            "command with --resume, or leave --resume out and add -f to start again"
        )


def _flat(record: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    """The values of nested records, by names such as settings.update.patches."""
    for name, value in record.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{above}{name}.")
        else:
            yield f"{above}{name}", value
