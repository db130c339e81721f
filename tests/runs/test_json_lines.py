"""A record becomes one line of JSON."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

from gsedit.run.json_lines import plain, write_line


@dataclass(frozen=True)
class Measured:
    name: str
    error: float | None
    sizes: tuple[int, ...] = ()


def test_plain_values_are_what_json_has():
    record = Measured("needle", math.nan, (1, 2))
    value = {"row": record, "path": Path("out/a"), 3: [math.inf, -math.inf, 0.5, True, None]}
    assert plain(value) == {
        "row": {"name": "needle", "error": None, "sizes": [1, 2]},
        "path": str(Path("out/a")),
        "3": [None, None, 0.5, True, None],
    }


def test_any_mapping_is_an_object():
    assert plain(MappingProxyType({"error": math.nan})) == {"error": None}


def test_a_line_is_on_disk_before_the_next(tmp_path):
    path = tmp_path / "rows.jsonl"
    with path.open("w", encoding="utf-8") as file:
        write_line(file, Measured("a", math.inf))
        assert json.loads(path.read_text()) == {"name": "a", "error": None, "sizes": []}
