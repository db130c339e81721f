"""One capture of a small room, shared by the tests that look at it."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import gsedit
from lens_photos import take, walk


@dataclass(frozen=True, eq=False)
class Captured:
    """The result of one `gsedit capture`, and the truth."""

    photos: Path
    scene: Path
    known: dict[str, np.ndarray]
    """World to camera, by the stem of the photo's name; z is up."""
    record: dict[str, Any]
    stages: list[str]
    messages: str


@pytest.fixture(scope="session")
def captured(tmp_path_factory) -> Captured:
    """Twelve photos of 192x192 pixels, without poses or EXIF, and a file that is none."""
    folder = tmp_path_factory.mktemp("capture")
    known = take(folder / "photos", walk(12))
    (folder / "photos" / "notes.jpg").write_text("no picture")
    result = gsedit(
        "capture",
        folder / "photos",
        "-o",
        folder / "scene",
        "--json",
        "--threads",
        2,
        "--set",
        "features=600",
        "--size",
        192,
    )
    assert result.exit_code == 0, result.stderr
    *events, record = (json.loads(line) for line in result.stdout.splitlines())
    stages = list(dict.fromkeys(event["stage"] for event in events))
    return Captured(folder / "photos", folder / "scene", known, record, stages, result.stderr)
