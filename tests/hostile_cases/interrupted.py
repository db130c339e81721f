"""Damaged checkpoints and edit folders."""

from __future__ import annotations

import json
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from math import nan
from pathlib import Path
from typing import Any

import torch

from gsedit.formats.scenes import save
from hostile_cases.base import (
    EDIT,
    LONG,
    Case,
    Words,
    a_scene,
    bad_texts,
    json_text,
)

RESUMED = ("scene.ply", "turn it into gold", "--size", "64", "--set", "update_steps=60",
           "--loss", "mse+gram", "--batches", "1", "--views", "2", "--steps", "1",
           "--checkpoint-every", "0", "-o")  # fmt: skip


def _interrupted(given: Path) -> Path:
    """Make an edit that was killed after a step; its folder, once."""
    out = given / "out/e"
    checkpoint = out / "checkpoint.safetensors"
    if not checkpoint.exists():
        given.mkdir(parents=True, exist_ok=True)
        save(a_scene(), given / "scene.ply", overwrite=True)
        command = [sys.executable, "-m", "gsedit_cli", "edit", *RESUMED, "out/e", "-f"]
        with subprocess.Popen(command, cwd=given, stderr=subprocess.DEVNULL) as work:
            while work.poll() is None and not _has_moments(checkpoint):
                time.sleep(0.02)
            work.send_signal(signal.SIGKILL)
    assert checkpoint.exists(), "the edit ended before a checkpoint after its first step"
    return given


def _has_moments(checkpoint: Path) -> bool:
    from safetensors import safe_open

    if not checkpoint.exists():
        return False
    with safe_open(checkpoint, framework="pt") as file:
        return any("first" in name for name in file.keys())  # noqa: SIM118


def checkpoints(given: Path) -> Iterator[Case]:
    """Damage a checkpoint, and go on with it, or convert it into a scene."""
    from safetensors import safe_open

    def records() -> list[tuple[str, Callable[[Any], Any]]]:
        changes: list[tuple[str, Callable[[Any], Any]]] = [
            (f"whole is {value!r}", lambda _, v=value: v) for value in (None, [], 7, "x", {})
        ]
        path = _interrupted(given) / "out/e/checkpoint.safetensors"
        with safe_open(path, framework="pt") as file:
            keys = [k for k in json.loads(file.metadata()["gsedit"]) if k != "format"]
        for key in keys:
            for value in (None, [], {}, "x", -1, 1e308, [[[]]], LONG):
                name = f"{key} is {'long' if value == LONG else repr(value)}"
                changes.append((name, lambda r, k=key, v=value: {**r, k: v}))
        return changes

    for name, change in records():
        for verb in ("convert", "resume"):
            if verb == "convert" or hash_of(name) % 3 == 0:
                yield Case(
                    f"checkpoint {verb}", name,
                    lambda a, c=change, v=verb: _checkpoint(a, given, v, record=c),
                    apart="fork" if verb == "resume" else "",
                )  # fmt: skip
    shapes: dict[str, Callable[[torch.Tensor], torch.Tensor]] = {
        "one row": lambda t: t[:1] if t.ndim else t, "none": lambda t: t.flatten()[:0],
        "flat": lambda t: t.reshape(-1),
        "nan": lambda t: t * nan if t.is_floating_point() else t,
        "float16": lambda t: t.half(), "another shape": lambda t: torch.zeros(7, 5, 2),
        "number": lambda t: torch.tensor(3.0), "integers": lambda t: t.long(),
    }  # fmt: skip
    for part in ("value", "first", "second", ""):
        for name, change in shapes.items():
            for verb in ("convert", "resume"):
                yield Case(
                    f"checkpoint {verb}", f"tensors {part} {name}",
                    lambda a, c=change, v=verb, p=part: _checkpoint(a, given, v, tensors=(p, c)),
                    apart="fork" if verb == "resume" else "",
                )  # fmt: skip


def hash_of(text: str) -> int:
    """Return a number that is the same in every process."""
    return sum(text.encode())


def _checkpoint(
    arena: Path,
    given: Path,
    verb: str,
    record: Callable[[Any], Any] | None = None,
    tensors: tuple[str, Callable[[torch.Tensor], torch.Tensor]] | None = None,
) -> Words:
    from safetensors import safe_open
    from safetensors.torch import save_file

    _copied(_interrupted(given), arena)
    path = arena / "out/e/checkpoint.safetensors"
    with safe_open(path, framework="pt") as file:
        text = file.metadata()["gsedit"]
        held = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    if record is not None:
        text = json_text(record(json.loads(text)))
    if tensors is not None:
        part, change = tensors
        held = {k: change(v).contiguous() if part in k else v for k, v in held.items()}
    save_file(held, path, metadata={"gsedit": text})
    if verb == "convert":
        return ["convert", "out/e", "-o", "out/s.ply"]
    return ["edit", *RESUMED, "out/e", "--resume"]


def _copied(given: Path, arena: Path) -> None:
    shutil.copy(given / "scene.ply", arena)
    shutil.copytree(given / "out", arena / "out")


def edit_folders(given: Path) -> Iterator[Case]:
    """Damage the records of an edit that is edited again."""
    from command_line import gsedit

    gsedit("edit", _interrupted(given) / "scene.ply", "as gold", *EDIT, "-o", given / "done")
    for file in ("edit.json", "views.json", "cameras.json"):
        for text in (*bad_texts(), '{"history": 7}', '{"history": [7]}', '{"prompt": []}'):
            yield Case(
                f"folder {file}", text[:16],
                lambda a, f=file, t=text: _edit_folder(a, given, f, t, ["info", "out/e"]),
            )  # fmt: skip
            yield Case(
                f"folder {file}", f"{text[:16]} edited",
                lambda a, f=file, t=text: _edit_folder(
                    a, given, f, t, ["edit", "out/e", "as gold", *EDIT, "-o", "out/e2"]),
            )  # fmt: skip


def _edit_folder(arena: Path, given: Path, file: str, text: str, words: Words) -> Words:
    shutil.copytree(given / "done", arena / "out/e")
    (arena / "out/e" / file).write_text(text)
    return words
