"""USD's text form, .usda, read as definitions with values; lists of numbers stay in the file.

References, variants and the like are not followed: who meets one needs a USD library.
Source: openusd.org, "usda" 1.0; the files that usd-core 26.11 writes.
"""

from __future__ import annotations

import mmap
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NoReturn

from gsedit.errors import InputError
from gsedit.storage.inputs import existing_file

MAGIC = b"#usda "
_MOST_TOKENS = 1_000_000
"""Words and signs beside the lists of numbers: a stage of 10,000 shapes has fewer."""
_DEEPEST = 100
"""Definitions, or brackets, inside one another."""
_LONGEST = 1 << 16
"""Characters of one word, text or name."""
_ARCS = {"references", "payload", "subLayers", "inherits", "specializes", "variants", "variantSets",
         "clips"}  # fmt: skip
_ESCAPED, _ENDS = re.compile(r"\\(.)", re.DOTALL), {"n": "\n", "t": "\t", "r": "\r"}
_SKIP = re.compile(rb"[\s;]*(?:#[^\n]*)?")
_LIST = re.compile(rb"\[[-+0-9.eE,()\sinfa]*\]")
_TOKEN = re.compile(
    rb"""(?P<text>\"\"\"(?:[^"\\]|\\.|"(?!""))*\"\"\"|'''(?:[^'\\]|\\.|'(?!''))*'''
      |"(?:[^"\\\n]|\\.)*"|'(?:[^'\\\n]|\\.)*')
    |(?P<asset>@@@(?:[^@]|@{1,2}(?!@))*@@@|@[^@\n]*@)|(?P<path><[^<>\n]*>)
    |(?P<number>[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?(?!\w)|[-+]?(?:inf|nan)(?![\w:]))
    |(?P<word>[A-Za-z_][\w:.]*(?:\[\])?)
    |(?P<sign>[=(){}\[\],:])""",
    re.VERBOSE | re.DOTALL,
)


class NeedsLibrary(Exception):
    """A file that only a USD library can put together; the text says why."""


@dataclass(frozen=True)
class Span:
    """A list of numbers, or of tuples of them: its place in the file, without the brackets."""

    start: int
    end: int


@dataclass(eq=False)
class Prim:
    """One definition: what it is, its values and what is below it."""

    specifier: str
    """def, over or class; empty for the layer itself."""
    kind: str
    """Type name of the schema; empty where none is told."""
    name: str
    metadata: dict[str, Any] = field(default_factory=dict)
    values: dict[str, Any] = field(default_factory=dict)
    """Values of attributes by name: float, str, Span, or list and dict of them; None where the
    file declares an attribute without a value. Values over time are under NAME.timeSamples."""
    children: list[Prim] = field(default_factory=list)


def read_layer(path: Path) -> Prim:
    """The layer as a Prim without a name, its metadata and the definitions below it.

    Raises InputError for a text that is none of USD, NeedsLibrary for one that names other layers.
    """
    with (
        existing_file(path).open("rb") as file,
        mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data,
    ):
        if data[: len(MAGIC)] != MAGIC:
            raise InputError(f"{path} does not begin with #usda: export it again")
        return _Parser(path, data).layer()


class _Parser:
    """Reads one text from its beginning to its end."""

    def __init__(self, path: Path, data: mmap.mmap) -> None:
        self.path, self.data, self.at, self.depth = path, data, 0, 0
        self.tokens = self._tokens()
        self.kind, self.value = "", ""
        self.span = Span(0, 0)
        self.next()

    def _tokens(self) -> Iterator[None]:
        """Steps that set `kind`, `value` and `span`; `kind` is empty at the end of the text."""
        for _ in range(_MOST_TOKENS):
            self.skip()
            found = _LIST.match(self.data, self.at)
            if found:  # its bytes stay in the file
                self.at, self.kind = found.end(), "list"
                self.span = Span(found.start() + 1, found.end() - 1)
            elif found := _TOKEN.match(self.data, self.at, self.at + _LONGEST):
                self.at, self.kind = found.end(), str(found.lastgroup)
                self.value = found.group().decode("utf-8", "replace")
            elif self.at == len(self.data):
                self.kind = self.value = ""
            else:
                self.fail("no word of USD")
            yield
        self.fail(f"more than {_MOST_TOKENS:,} words")

    def skip(self) -> None:
        """Pass spaces and comments."""
        end = -1
        while end != self.at:
            end = self.at
            found = _SKIP.match(self.data, end)
            self.at = found.end() if found else end

    def next(self) -> None:
        next(self.tokens)

    def fail(self, what: str) -> NoReturn:
        raise InputError(
            f"{self.path}: {what} at byte {self.at}: it is cut off or damaged, export it again"
        )

    def sign(self, sign: str) -> bool:
        """Whether the sign comes next; then it is passed."""
        if self.kind == "sign" and self.value == sign:
            self.next()
            return True
        return False

    def need(self, sign: str) -> None:
        if not self.sign(sign):
            self.fail(f"no {sign}")

    def word(self) -> str:
        """The next word, passed."""
        if self.kind != "word":
            self.fail("no name")
        value = self.value
        self.next()
        return value

    def layer(self) -> Prim:
        metadata = self.metadata() if self.sign("(") else {}
        layer = Prim("", "", "", metadata)
        while self.kind:
            self.item(layer)
        return layer

    def item(self, prim: Prim) -> None:
        """One definition, attribute or relation below `prim`."""
        first = self.word()
        if first in ("def", "over", "class"):
            prim.children.append(self.prim(first))
        elif first == "variantSet":
            raise NeedsLibrary("it has variants")
        elif first == "reorder":
            self.word()
            self.need("=")
            self.any_value()
        else:
            self.attribute(prim, first)

    def prim(self, specifier: str) -> Prim:
        kind = self.word() if self.kind == "word" else ""
        if self.kind != "text":
            self.fail("a definition without a name")
        prim = Prim(specifier, kind, _text(self.value))
        self.next()
        if self.sign("("):
            prim.metadata = self.metadata()
        self.depth += 1
        if self.depth > _DEEPEST:
            self.fail("too many definitions inside one another")
        self.need("{")
        while not self.sign("}"):
            self.item(prim)
        self.depth -= 1
        return prim

    def attribute(self, prim: Prim, first: str) -> None:
        """`custom uniform TYPE NAME = VALUE (METADATA)`, of which much may be missing."""
        words = [first]
        while self.kind == "word":
            words.append(self.word())
        if len(words) < 2:
            self.fail("an attribute without a name")
        value = self.any_value() if self.sign("=") else None
        prim.values[words[-1]] = value
        if self.sign("("):
            self.metadata()

    def metadata(self) -> dict[str, Any]:
        """Entries until the bracket closes; a text alone is a comment."""
        found: dict[str, Any] = {}
        while not self.sign(")"):
            if self.kind == "text":
                self.next()
                continue
            name = self.word()
            if name in ("add", "append", "prepend", "delete", "reorder"):
                name = self.word()
            self.need("=")
            if name in _ARCS:
                raise NeedsLibrary(f"it has {name}")
            found[name] = self.any_value()
        return found

    def any_value(self) -> Any:
        kind, value, span = self.kind, self.value, self.span
        self.next()
        if kind == "number":
            return float(value)
        if kind == "list":
            return span
        if kind == "text":
            return _text(value)
        if kind in ("word", "asset", "path"):
            return value
        if kind == "sign" and value in "([{":
            self.depth += 1
            if self.depth > _DEEPEST:
                self.fail("too many brackets inside one another")
            found = self.entries() if value == "{" else self.several(")" if value == "(" else "]")
            self.depth -= 1
            return found
        self.fail("no value")

    def several(self, end: str) -> list[Any]:
        found = []
        while not self.sign(end):
            found.append(self.any_value())
            if not self.sign(","):
                self.need(end)
                break
        return found

    def entries(self) -> dict[str, Any]:
        """`TYPE NAME = VALUE` of a dictionary, or `TIME: VALUE` of values over time."""
        found: dict[str, Any] = {}
        while not self.sign("}"):
            if self.kind == "number":
                key = self.value
                self.next()
                self.need(":")
            else:
                self.word()
                key = _text(self.value)
                if self.kind not in ("word", "text"):
                    self.fail("no name")
                self.next()
                self.need("=")
            found[key] = self.any_value()
            self.sign(",")
        return found


def _text(quoted: str) -> str:
    """A text without its quotes."""
    three = quoted[:3] in ('"""', "'''") and len(quoted) >= 6
    inner = quoted[3:-3] if three else quoted[1:-1] if quoted[:1] in "\"'" else quoted
    return _ESCAPED.sub(lambda found: _ENDS.get(found[1], found[1]), inner)
