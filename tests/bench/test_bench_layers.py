"""The rooms of the benchmarks share modules of gsedit/bench and know nothing of each other."""

from __future__ import annotations

import pytest
from test_layers import ROOT, imports

BENCH = ROOT / "gsedit" / "bench"
ROOMS = ("renderer", "sampler")


def imported(folder) -> set[str]:
    return {name for path in folder for name in imports(path) if name.startswith("gsedit.bench.")}


@pytest.mark.parametrize("room", ROOMS)
def test_a_room_imports_no_other_room(room):
    names = imported((BENCH / room).glob("*.py"))
    assert names
    assert {name for name in names if name.split(".")[2] in set(ROOMS) - {room}} == set()


def test_shared_modules_import_no_room():
    names = imported(BENCH.glob("*.py"))
    assert {name for name in names if name.split(".")[2] in ROOMS} == set()
