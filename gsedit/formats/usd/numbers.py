"""The numbers of a .usda, read and written a part at a time, as float32."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import IO

import numpy as np
from jaxtyping import Float32

from gsedit.errors import InputError
from gsedit.formats.usd.text import Span

_PIECE = 1 << 20
"""Bytes that are read and parsed at a time."""
_LONGEST = 1 << 12
"""Bytes of one number or tuple."""
_WITHOUT_BRACKETS = bytes.maketrans(b"()", b"  ")


class NumberList:
    """The rows of a list of numbers (width 1) or of tuples of `width`, from the first on."""

    def __init__(self, path: Path, span: Span, width: int, what: str) -> None:
        self.path, self.span, self.width, self.what = path, span, width, what
        self.at = span.start
        self.rest = b""
        self.ready = np.empty((0, width), np.float32)

    def count(self) -> int:
        """Number of rows that the list has by its commas or brackets."""
        rows, at, last = 0, self.span.start, b""
        mark = b"," if self.width == 1 else b"("
        while piece := self._read(at):
            at += len(piece)
            rows += piece.count(mark)
            last = (last + piece)[-_LONGEST:]
        last = last.strip()
        return rows + (self.width == 1 and last != b"" and not last.endswith(b","))

    def take(self, rows: int) -> Float32[np.ndarray, "n w"]:
        """The next rows, fewer at the end. Raises InputError for what are no such numbers."""
        parts, have = [self.ready], len(self.ready)
        while have < rows:
            part = self._next()
            if part is None:
                break
            parts.append(part)
            have += len(part)
        values = np.concatenate(parts)
        self.ready = values[rows:]
        return values[:rows]

    def _read(self, at: int) -> bytes:
        with self.path.open("rb") as file:
            file.seek(at)
            return file.read(max(0, min(_PIECE, self.span.end - at)))

    def _next(self) -> Float32[np.ndarray, "n w"] | None:
        piece = self._read(self.at)
        self.at += len(piece)
        text = self.rest + piece
        self.rest = b""
        if piece and self.at < self.span.end:
            end = b"," if self.width == 1 else b")"
            cut = text.rfind(end)
            if len(text) - cut > _LONGEST:
                raise self._wrong()
            text, self.rest = text[: cut + 1], text[cut + 1 :]
        text = text.translate(_WITHOUT_BRACKETS).strip(b", \t\r\n")
        if not text:
            return None
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                values = np.fromstring(text, np.float64, sep=",")  # stops at what is no number
        except (ValueError, DeprecationWarning):
            raise self._wrong() from None
        if len(values) % self.width:
            raise self._wrong()
        with np.errstate(over="ignore"):
            return values.astype(np.float32).reshape(-1, self.width)

    def _wrong(self) -> InputError:
        return InputError(
            f"{self.path}: {self.what} are not rows of {self.width} "
            f"number{'s' * (self.width > 1)}: it is damaged, export it again"
        )


def write_rows(values: np.ndarray, file: IO[bytes]) -> None:
    """Append rows (n, w) to a list: nine digits a number, which are float32 exactly."""
    width = values.shape[1]
    row = "%.9g" if width == 1 else "(" + ", ".join(["%.9g"] * width) + ")"
    for start in range(0, len(values), 4096):
        part = values[start : start + 4096]
        text = ", ".join([row] * len(part)) % tuple(part.ravel().tolist())
        file.write((", " if file.tell() else "").encode() + text.encode())
