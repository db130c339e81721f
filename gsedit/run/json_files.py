"""JSON of others and of gsedit, read in one way: bounded, every failure one line with its place.

A check takes a value and its place in the file, as frames[3].fl_x, and returns the value as the
reader needs it. Checks are put together: `list_of(object_of({"w": number(1, 9), "name": text()}))`.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping
from io import SEEK_END
from math import inf, isfinite
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from gsedit.errors import InputError
from gsedit.run.inputs import open_regular

MAX_BYTES = 256 << 20
"""Largest file of JSON: a million frames have 250 bytes each; their objects take some GB."""
_UNWRITABLE = re.compile("[\0\ud800-\udfff]")  # half a character pair: no encoding has one
AGAIN = "repair it or copy it again"
Check: TypeAlias = Callable[[Any, str], Any]
"""Function of a value and its place that returns the value, or raises Misfit."""


class Misfit(ValueError):
    """Error of a value that is not what it must be; its text begins with the place."""


def read_json(path: Path, check: Check | None = None, *, advice: str = AGAIN) -> Any:
    """The value in a file of JSON, as `check` returns it.

    Raises InputError, with the place and the advice, for a file that cannot be read, is empty,
    larger than MAX_BYTES or no JSON, and for a value that the check refuses.
    """
    with open_regular(path) as file:
        size = file.seek(0, SEEK_END)
        if size > MAX_BYTES:
            raise InputError(f"{path} has more than {MAX_BYTES >> 20} MB of JSON: {advice}")
        file.seek(0)
        data = file.read(size)
    if not data:
        raise InputError(f"{path} is empty (0 bytes): {advice}")
    return parse_json(data, path, check, advice=advice)


def parse_json(
    data: bytes | str, where: str | Path, check: Check | None = None, *, advice: str = AGAIN
) -> Any:
    """The value of a text of JSON, as `check` returns it. Raises InputError; `where` begins it."""
    try:
        value = json.loads(data, parse_int=lambda n: int(n) if len(n) <= 19 else float(n))
    except json.JSONDecodeError as error:
        place = f"line {error.lineno}, column {error.colno}"
        raise InputError(f"{where}: {place}: {error.msg}: {advice}") from None
    except (ValueError, RecursionError, OverflowError) as error:
        kind = type(error).__name__
        raise InputError(f"{where} is not JSON text ({kind}): {advice}") from None
    return value if check is None else checked(value, check, where, advice=advice)


def checked(value: Any, check: Check, where: str | Path, *, advice: str = AGAIN) -> Any:
    """The value as the check returns it. Raises InputError that begins with `where`."""
    try:
        return check(value, "")
    except Misfit as error:
        raise InputError(f"{where}: {error}: {advice}") from None


def number(least: float | int = -inf, most: float | int = inf, *, whole: bool = False) -> Check:
    """A check for a finite number from `least` to `most`; returns a float, an int if `whole`."""

    def check(value: Any, place: str) -> float | int:
        if isinstance(value, bool) or not isinstance(value, int | float) or not isfinite(value):
            raise Misfit(f"{place} is {_short(value)}, not a number")
        if not least <= value <= most:
            raise Misfit(f"{place} is {value:g}, not from {least:g} to {most:g}")
        if whole and value != int(value):
            raise Misfit(f"{place} is {value:g}, not a whole number")
        return int(value) if whole else float(value)

    return check


def numbers(*shape: int, most: float = inf) -> Check:
    """A check for nested lists of finite numbers, none beyond `most`; returns a float64 array."""
    shown = "x".join(map(str, shape))

    def check(value: Any, place: str) -> np.ndarray:
        try:
            array = np.array(value)
        except (ValueError, OverflowError, RecursionError):
            array = np.zeros(0)
        if array.shape != shape or array.dtype.kind not in "iuf":
            raise Misfit(f"{place} is not {shown} numbers")
        if not np.isfinite(array).all():
            raise Misfit(f"{place} is not finite")
        if np.abs(array).max(initial=0) > most:
            raise Misfit(f"{place} has a number beyond {most:g}")
        return array.astype(np.float64)

    return check


def text(longest: int = 4096, *, empty: bool = False) -> Check:
    """A check for a text that can be the path of a file (of Linux); `empty` if it may be empty."""

    def check(value: Any, place: str) -> str:
        if not isinstance(value, str) or not (value or empty) or _UNWRITABLE.search(value):
            raise Misfit(f"{place} is {_short(value)}, not a text")
        if len(value) > longest:
            raise Misfit(f"{place} has {len(value)} characters, {longest} are allowed")
        return value

    return check


def list_of(each: Check, least: int = 0, most: float | int = inf) -> Check:
    """A check for a list of `least` to `most` values; returns what `each` returns, as a list."""

    def check(value: Any, place: str) -> list[Any]:
        if not isinstance(value, list) or not least <= len(value) <= most:
            what = f"{place or 'the file'} is no list"
            raise Misfit(what + f" of {least} to {most} values".replace(" to inf", " or more"))
        return [each(one, f"{place}[{i}]") for i, one in enumerate(value)]

    return check


def object_of(needed: Mapping[str, Check], optional: Mapping[str, Check] | None = None) -> Check:
    """A check for an object with the needed keys. Optional ones may be missing or null, which
    leaves them out; other keys are kept as they are."""
    optional = optional or {}

    def check(value: Any, place: str) -> dict[str, Any]:
        if not isinstance(value, dict):
            named = f" with {', '.join(needed)}" if needed else ""
            raise Misfit(f"{place or 'the file'} is no object{named}")
        start = f"{place}." if place else ""
        missing = next((key for key in needed if value.get(key) is None), None)
        if missing is not None:
            raise Misfit(f"{place or 'the file'} has no {missing}")
        found = {k: each for k, each in value.items() if k not in optional or each is not None}
        for key, each in (*needed.items(), *optional.items()):
            if key in found:
                found[key] = each(found[key], f"{start}{key}")
        return found

    return check


def _short(value: Any) -> str:
    if isinstance(value, dict | list):
        return "a list" if isinstance(value, list) else "an object"
    shown = ascii(value)
    return shown if len(shown) <= 80 else f"{shown[:80]}..."
