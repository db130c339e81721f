"""A record becomes one line of JSON and back; what is not a record is named with its line."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import pytest

from gsedit.errors import InputError
from gsedit.runs.json_lines import plain, read_lines, write_line


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


def read(path: Path) -> list[Measured]:
    return read_lines(path, Measured, kind="a measurement", advice="give rows.jsonl")


def test_lines_are_read_back_without_the_one_that_was_cut_off(tmp_path):
    path = tmp_path / "rows.jsonl"
    path.write_text('{"name": "a", "error": 1.0}\n\n{"name": "b", "error": null}\n{"name": "c')
    assert read(path) == [Measured("a", 1.0), Measured("b", None)]


@pytest.mark.parametrize("line", ["{", "3", "[]", '{"name": "b"}', '{"name": "b", "odd": 1}'])
def test_a_line_that_is_no_record_is_named(tmp_path, line):
    path = tmp_path / "rows.jsonl"
    path.write_text(f'{{"name": "a", "error": 1.0}}\n{line}\n')
    with pytest.raises(InputError, match=r"rows\.jsonl, line 2: not a measurement.*give rows"):
        read(path)


def test_a_file_that_cannot_be_read_is_named(tmp_path):
    with pytest.raises(InputError, match=r"absent\.jsonl cannot be read"):
        read(tmp_path / "absent.jsonl")
    (tmp_path / "bytes.jsonl").write_bytes(b"\xff\xfe\n")
    with pytest.raises(InputError, match=r"bytes\.jsonl: cannot be read"):
        read(tmp_path / "bytes.jsonl")
