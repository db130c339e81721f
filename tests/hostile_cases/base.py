"""Parts that the hostile cases share: an ordinary scene, absurd numbers, names and texts."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from math import inf, nan
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from bad_files import ply_bytes
from point_clouds import ball

from gsedit.formats.ply.inria import columns
from rasterizer import Gaussians

Words = list[Any]
Record = dict[str, Any]
EDIT = ("--size", 64, "--set", "update_steps=2", "--batches", 1, "--views", 2, "--steps", 1)
"""Options of the shortest edit."""
DEEP = 100_000
LONG = 10**5000 - 1
"""More digits than Python reads."""
NUMBERS = (nan, inf, -inf, 0, -1, 1e308, -1e308, 1e-320, 2**63, 10**400, LONG)
OTHERS = (None, True, "x", "", [], {}, [None], [1e308] * 3, "a" * 5000)
NAMES = (
    "../../../escaped", "{absolute}", "victim/holiday", "../victim/holiday", "..", ".", "/", "",
    "a/../../b", "a\0b", "a\nb", "\x1b]0;title\x07", "\x1b[31mred", "~/x", "$(touch x)", "a" * 300,
    "..\\..\\x", "C:\\x", "a b", "-o", "caf\u00e9", "\u202egnp", "con", "CON.png", "a//b", "./a",
)  # fmt: skip


@dataclass(frozen=True)
class Case:
    """A command on made input."""

    kind: str
    name: str
    make: Callable[[Path], Words]
    """Writes the input into a folder, from which the command then runs; the command's words."""
    apart: Literal["", "fork", "process"] = ""
    """Whether it may end the process: a copy of this one runs it, or a new one."""
    disk: int = 0
    """Size of the disk under out/, bytes: a tmpfs of a copy of this process. 0: that of the folder.
    """


def a_scene(degree: int = 1, count: int = 200) -> Gaussians:
    """An ordinary ball of small Gaussians."""
    scene = ball(count)
    sh = torch.zeros(count, (degree + 1) ** 2, 3)
    sh[:, :1] = scene.sh[:, :1]
    return replace(scene, sh=sh)


def saved(arena: Path, scene: Gaussians, words: Words) -> Words:
    """Write a scene where the words expect it, valid or not (`save` refuses some)."""
    k = scene.sh.shape[1]
    fields = {"x": scene.means, "f_dc_0": scene.sh[:, 0], "opacity": scene.logit_opacities[:, None],
              "f_rest_0": scene.sh[:, 1:].transpose(1, 2).flatten(1),
              "scale_0": scene.log_scales, "rot_0": scene.quats}  # fmt: skip
    names = columns(k)
    table = np.zeros((len(scene), len(names)), "<f4")
    for name, values in fields.items():
        if name in names:
            at = names.index(name)
            table[:, at : at + values.shape[1]] = values.numpy()
    (arena / "scene.ply").write_bytes(ply_bytes(table, names))
    return words


def json_text(value: Any) -> str:
    """Write a record as JSON, with integers of any length."""
    limit = sys.get_int_max_str_digits()
    sys.set_int_max_str_digits(0)
    try:
        return json.dumps(value)
    finally:
        sys.set_int_max_str_digits(limit)


def bad_texts() -> tuple[str, ...]:
    """Name texts that are no record."""
    return ("", "[", "{}", "null", "7", '"x"', "[[]]", "[null]", "[7]", "[" * DEEP, '{"a":' * DEEP,
            "[]", "\x00", "{" + "9" * 5000, '[{"id": 0}]')  # fmt: skip
