"""Scenes at the end of what numbers can say, looked at, rendered, changed and edited."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from math import inf, nan

import torch

from gsedit.formats.table import WRITABLE
from hostile_cases.base import (
    EDIT,
    Case,
    Words,
    a_scene,
    saved,
)
from rasterizer import Gaussians


def with_value(field: str, value: float, rows: slice) -> Gaussians:
    """An ordinary scene, some rows of which have another number in one field."""
    scene = a_scene()
    changed = getattr(scene, field).clone()
    changed[rows] = value
    return replace(scene, **{field: changed})


def extremes() -> Iterator[tuple[str, Gaussians]]:
    """Name scenes that are valid, or look so, and lie at the end of what numbers can say."""
    one, all_ = slice(7, 8), slice(None)
    for value in (1e20, 1e30, 3e38, -3e38):
        yield f"one position {value:g}", with_value("means", value, one)
        yield f"a few positions {value:g}", with_value("means", value, slice(0, 5))
    for value in (1e10, 1e30, 1e38):
        yield f"one SH {value:g}", with_value("sh", value, one)
        yield f"all SH {value:g}", with_value("sh", value, all_)
    for value in (-50.0, -100.0, 10.0, 30.0, 39.0):
        yield f"all log scales {value:g}", with_value("log_scales", value, all_)
        yield f"one log scale {value:g}", with_value("log_scales", value, one)
    for value in (-30.0, 30.0, 1e30, -1e30):
        yield f"all opacities {value:g}", with_value("logit_opacities", value, all_)
    for value in (0.0, 1e-30, 1e30):
        yield f"all rotations {value:g}", with_value("quats", value, all_)
    for factor in (1e-6, 1e-3, 1e3, 1e7):
        scene = a_scene()
        larger = scene.log_scales + torch.tensor(factor).log()
        yield f"units {factor:g}", replace(scene, means=scene.means * factor, log_scales=larger)
    yield "far from the origin", replace(a_scene(), means=a_scene().means + 1e7)
    yield "one Gaussian", a_scene()[torch.tensor([0])]
    yield "two Gaussians", a_scene()[torch.tensor([0, 1])]
    yield "none", a_scene()[torch.zeros(0, dtype=torch.long)]
    yield "all at one place", a_scene()[torch.zeros(50, dtype=torch.long)]
    yield "on a line", replace(a_scene(), means=a_scene().means * torch.tensor([1.0, 0, 0]))
    for value in (nan, inf):
        for field in ("means", "sh", "log_scales", "logit_opacities", "quats"):
            yield f"one {field} {value}", with_value(field, value, one)


def scenes() -> Iterator[Case]:
    """Look at, render, change and edit every extreme scene."""
    verbs: dict[str, Words] = {
        "info": ["info", "scene.ply"],
        "check": ["info", "scene.ply", "--check"],
        "repair": ["clean", "scene.ply", "--repair", "-o", "out/w.ply"],
        "view": ["view", "scene.ply", "-o", "out/v.html"],
        "render": ["render", "scene.ply", "--size", 32, "--count", 1, "-o", "out/r"],
        "filter": ["filter", "scene.ply", "--where", "opacity > 0.1", "-o", "out/f.ply"],
        **{f"convert {end}": ["convert", "scene.ply", f"out/c{end}"] for end in WRITABLE},
    }
    for name, scene in extremes():
        for verb, words in verbs.items():
            yield Case(
                f"scene {verb.split()[0]}",
                f"{name} {verb}",
                lambda a, s=scene, w=words: saved(a, s, w),
            )
    edited: Words = ["edit", "scene.ply", "turn it into gold", *EDIT, "-o", "out/e"]
    for index, (name, scene) in enumerate(extremes()):
        if index % 2 == 0:
            yield Case("scene edit", name, lambda a, s=scene: saved(a, s, edited))
