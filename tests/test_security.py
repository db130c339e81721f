"""SECURITY.md gives the limits of the code."""

from __future__ import annotations

from math import exp
from pathlib import Path

from gsedit.formats.gltf.document import JSON_MAX_BYTES
from gsedit.formats.limits import ALWAYS_BYTES, MAX_EXPANSION, MAX_POSITION, MAX_SH, MAX_SIDE
from gsedit.formats.npz import BESIDE_MAX_BYTES
from gsedit.formats.pictures import LIMIT_VARIABLE, MAX_MEGAPIXELS
from gsedit.formats.ply.inria import ELEMENTS_MAX_BYTES
from gsedit.formats.ply.records import HEADER_MAX_BYTES, MAX_COLUMNS, MAX_ELEMENTS
from gsedit.formats.sog.file import META_MAX_BYTES
from gsedit.formats.usd.file import EXPANSION as USD_EXPANSION
from gsedit.formats.usd.file import MEMORY as USD_MEMORY
from gsedit.formats.usd.file import SECONDS as USD_SECONDS
from gsedit.formats.validity import MAX_LOG_SCALE, MAX_NORM
from gsedit.select.where import LONGEST
from gsedit.storage.json_files import MAX_BYTES
from rasterizer.compiler import TIMEOUT_S

PAGE = Path(__file__).parents[1] / "SECURITY.md"


def megabytes(size: int) -> str:
    assert size % (1 << 20) == 0
    return f"{size >> 20} MB"


def test_limits_of_the_page_are_those_of_the_code():
    rows = [line.strip("| ").split(" | ") for line in PAGE.read_text().splitlines() if "| " in line]
    assert round(exp(MAX_LOG_SCALE)) == MAX_POSITION
    assert BESIDE_MAX_BYTES == ELEMENTS_MAX_BYTES
    header = (
        f"{megabytes(HEADER_MAX_BYTES)}, {MAX_ELEMENTS} elements, {MAX_COLUMNS:,} columns in each"
    )
    packed = f"{MAX_EXPANSION:,} times its size, or to {megabytes(ALWAYS_BYTES)}"
    picture = f"{MAX_MEGAPIXELS:g} megapixels; `{LIMIT_VARIABLE}` sets another number"
    inside = f"meta.json of a .sog {megabytes(META_MAX_BYTES)}; JSON of a .glb "
    memory, seconds, per_mb = USD_MEMORY >> 30, USD_SECONDS, USD_SECONDS // 10
    usd = f"{memory} GB of memory and {32 + USD_EXPANSION} times its size; {seconds} s"
    assert dict(rows[2:]) == {
        "header of a .ply": header,
        "packed scene": f"unpacks to at most {packed}",
        "USD, which usd-core reads in a child process": (
            f"{usd} and {per_mb} s a MB; names no layer elsewhere"
        ),
        "picture": picture,
        "JSON file": f"{megabytes(MAX_BYTES)}; {inside}{megabytes(JSON_MAX_BYTES)}",
        "picture of a camera": f"{MAX_SIDE:,} pixels a side",
        "position, scale": f"{MAX_POSITION:g} units".replace("+0", ""),
        "length of a quaternion": f"{MAX_NORM:g}".replace("+0", ""),
        "SH coefficient": f"{MAX_SH:,.0f}",
        "comments and other tables beside a scene": f"{megabytes(BESIDE_MAX_BYTES)} each",
        "expression of `--where`": f"{LONGEST:,} characters",
        "compiling a C++ file": f"{TIMEOUT_S:g} s",
    }
