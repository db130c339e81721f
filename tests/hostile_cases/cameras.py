"""Damaged cameras beside a scene: their numbers, their names, the text."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from pathlib import Path

from PIL import Image

from gsedit import orbit
from gsedit.datasets.viewpoints import Viewpoint
from gsedit.formats.scenes import save
from hostile_cases.base import (
    EDIT,
    LONG,
    NAMES,
    NUMBERS,
    OTHERS,
    Case,
    Record,
    Words,
    a_scene,
    bad_texts,
    json_text,
)


def _entries() -> list[Record]:
    """The record of eight ordinary cameras."""
    scene = a_scene()
    views = [Viewpoint(f"{i}.png", each) for i, each in enumerate(orbit(scene, 8, 64))]
    entries = []
    for i, view in enumerate(views):
        camera = view.camera
        entries.append({
            "id": i, "img_name": view.name, "width": 64, "height": 64,
            "position": camera.center.tolist(), "rotation": camera.rotation.T.tolist(),
            "fx": camera.fx, "fy": camera.fy,
        })  # fmt: skip
    return entries


def _with_cameras(arena: Path, text: str, words: Words) -> Words:
    save(a_scene(), arena / "scene.ply")
    text = text.replace("{absolute}", str(arena.parent / "escaped"))
    (arena / "cameras.json").write_text(text)
    (arena / "victim").mkdir()
    Image.new("RGB", (50, 30), "red").save(arena / "victim/holiday.png")
    return words


def cameras() -> Iterator[Case]:
    """Damage the cameras that lie beside a scene: their numbers, their names, the text."""
    rendered: Words = ["render", "scene.ply", "--size", 32, "--count", 2, "-o", "out/r"]
    edited: Words = ["edit", "scene.ply", "turn it into gold", *EDIT, "-o", "out/e"]
    entries = _entries()
    for key in ("position", "rotation", "fx", "fy", "width", "height", "id"):
        for value in (*NUMBERS, *OTHERS[:5]):
            own = copy.deepcopy(entries)
            if key in ("position", "rotation") and isinstance(value, int | float):
                first = own[1][key] if key == "position" else own[1][key][0]
                first[0] = value
            else:
                own[1][key] = value
            text = json_text(own)
            name = f"{key} {'long' if value == LONG else str(value)[:12]}"
            yield Case("cameras.json", name, lambda a, t=text: _with_cameras(a, t, rendered))
    for name in NAMES:
        own = copy.deepcopy(entries)
        own[0]["img_name"] = own[3]["img_name"] = name
        text = json_text(own)
        for words in (rendered, edited):
            yield Case(
                "camera names", f"{name[:20]!r} {words[0]}",
                lambda a, t=text, w=words: _with_cameras(a, t, w),
            )  # fmt: skip
    for text in bad_texts():
        yield Case("cameras.json", text[:12], lambda a, t=text: _with_cameras(a, t, rendered))
