"""Selections as expressions: `opacity > 0.1 and not sphere(0, 0, 0, 1) or near(#a08050, 10)`, and
their short forms, for people.

The grammar is that of Python's expressions, cut down: comparisons of values (`NAMED`, extra
columns, numbers, + - * / **, `VALUES`), the functions of `FORMS`, and, or, not. Python parses
the text; nothing of it is evaluated but what is listed here. `subject()`, `thing(...)` and the
other `questions` are answered by a `gsedit.select.finder.Finder` of the scene.
"""

from __future__ import annotations

import ast
import inspect
import operator
import re
from collections.abc import Callable, Mapping, Sequence
from difflib import get_close_matches
from itertools import pairwise
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np

from gsedit.errors import UsageError
from gsedit.scene.shapes import Bool
from gsedit.scene.table import SplatTable, gaussians_of
from gsedit.select.kinds import FORMS
from gsedit.select.selection import Selection, combined
from gsedit.select.values import (
    NAMED,
    VALUES,
    Amount,
    Value,
    compare,
    computed,
    parse_amount,
    value_named,
)

if TYPE_CHECKING:
    from gsedit.select.region import Region
    from rasterizer.scene import Gaussians

_OPERATORS: dict[type, Callable[..., Any]] = {
    ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul, ast.Div: np.divide,
    ast.Pow: np.power,
}  # fmt: skip
_COMPARISONS: dict[type, Callable[..., Any]] = {
    ast.Lt: operator.lt, ast.LtE: operator.le, ast.Gt: operator.gt, ast.GtE: operator.ge,
    ast.Eq: operator.eq, ast.NotEq: operator.ne,
}  # fmt: skip
_CONSTANTS = {"inf": float("inf"), "pi": 3.141592653589793}
LONGEST = 10_000
"""Characters of an expression: a list of a hundred spheres has 5,000."""
_COLOR = "_color_"
"""Takes the place of # in front of a color, which begins a comment in Python."""
_QUOTED = re.compile(r"""'[^']*'|"[^"]*\"""")
_UNREADABLE = {
    r"#\w*": "no color: write it as #a08050",
    r"(?<![\d.])[\d.]+\s*%|%": "quote a share, as in largest('10%', opacity)",
    r"(?<![<>=!])=(?=\s*-?[\d.]+\s*($|\band\b|\bor\b))": "compare with ==",
}
"""Spellings that Python reads differently or not at all, each with what to write instead."""
_QUOTED_OR_COLOR = re.compile(_QUOTED.pattern + r"|\#(?=(?:[0-9a-fA-F]{3}|[0-9a-fA-F]{6})(?!\w))")


Functions = Mapping[str, Callable[..., Any]]


def where(text: str, functions: Functions | None = None) -> Selection:
    """Return the selection of an expression, which may call `functions` besides `FORMS`.

    The types of their parameters say how to read arguments. A function
    replaces one of the same name. Raises UsageError, which quotes the wrong place.
    """
    reader = _Reader(text, {**FORMS, **VALUES, **(functions or {})})
    return reader.selection(reader.tree())


class _Reader:
    """One expression while it is read."""

    def __init__(self, text: str, functions: Functions) -> None:
        self.functions = functions
        self.text = " ".join(text.split("\n")).strip()
        self.source = _QUOTED_OR_COLOR.sub(
            lambda match: _COLOR if match[0] == "#" else match[0], self.text
        )

    def tree(self) -> ast.expr:
        if len(self.text) > LONGEST:
            raise UsageError(
                f"the expression {self.text[:40]!r}... has {len(self.text)} characters, {LONGEST} "
                "are allowed: filter in several steps with then"
            )
        if not self.source:
            raise UsageError("the expression is empty: give one, as in opacity > 0.1")
        unquoted = _QUOTED.sub(lambda match: " " * len(match[0]), self.source)
        for sign, problem in _UNREADABLE.items():
            if match := re.search(sign, unquoted):
                self.refuse(problem, match.start(), match.end())
        try:
            tree = ast.parse(self.source, mode="eval").body
        except SyntaxError as error:
            if _parses(f"{self.source} 0"):
                self.refuse("the expression is not complete", len(self.source))
            self.refuse(error.msg or "not readable", max((error.offset or 1) - 1, 0))
        except (ValueError, RecursionError, MemoryError, OverflowError):
            self.refuse("too deep, or a character that none can read", 0)
        if _depth(tree) > 100:  # Python's stack holds the evaluation
            self.refuse("too deep: write it shorter, or filter in several steps with then", 0)
        return tree

    def refuse(self, problem: str, start: int, end: int | None = None) -> NoReturn:
        """Raise UsageError about a piece of the source."""
        piece = self.source[start:end].replace(_COLOR, "#")
        place = len(self.source[:start].replace(_COLOR, "#")) + 1
        where = f"at {piece[:40]!r} (character {place})" if piece else "at the end"
        text = self.text if len(self.text) <= 200 else f"{self.text[:200]}..."
        raise UsageError(f"{text!r}, {where}: {problem}")

    def wrong(self, node: ast.expr, problem: str) -> NoReturn:
        # column offsets count bytes of UTF-8
        start, end = (
            len(self.source.encode()[:offset].decode(errors="ignore"))
            for offset in (node.col_offset, node.end_col_offset or 0)
        )
        self.refuse(problem, start, end)

    def selection(self, node: ast.expr) -> Selection:
        found = self.read(node)
        if not isinstance(found, Selection):
            problem = "a number where a condition is needed: compare it, as in opacity > 0.1"
            self.wrong(node, problem)
        return found

    def value(self, node: ast.expr) -> Value:
        found = self.read(node)
        if not isinstance(found, Value):
            self.wrong(node, "a condition where a number is needed")
        return found

    def read(self, node: ast.expr) -> Selection | Value:
        match node:
            case ast.BoolOp(op=op, values=values):
                join = np.logical_and if isinstance(op, ast.And) else np.logical_or
                return combined(join.reduce, *map(self.selection, values))
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                return ~self.selection(operand)
            case ast.Compare():
                return self.comparison(node)
            case ast.Constant(value=int() | float() as number) if not isinstance(number, bool):
                try:
                    return _constant(float(number))
                except OverflowError:
                    self.wrong(node, "too large a number")
            case ast.UnaryOp(op=ast.UAdd(), operand=operand):
                return self.value(operand)
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                inner = self.value(operand)
                if inner.number is not None:
                    return _constant(-inner.number)
                return computed(operator.sub, _constant(0.0), inner)
            case ast.Name(id=name) if name in _CONSTANTS:
                return _constant(_CONSTANTS[name])
            case ast.Name(id=name) if name in self.functions:
                self.wrong(node, f"write {_usage(name, self.functions[name])}")
            case ast.Name(id=name):
                return value_named(name)  # perhaps an extra column of the file
            case ast.BinOp(left=left, op=op, right=right) if type(op) in _OPERATORS:
                return computed(_OPERATORS[type(op)], self.value(left), self.value(right))
            case ast.BinOp(op=ast.BitAnd() | ast.BitOr()) | ast.UnaryOp(op=ast.Invert()):
                self.wrong(node, "write and, or, not for &, |, ~")
            case ast.Call(func=ast.Name(id=name)) if name in self.functions:
                return self.call(node, name, self.functions[name])
            case ast.Call(func=ast.Name(id=name)):
                close = get_close_matches(name, self.functions, 1)
                known = f"there are {', '.join(self.functions)}"
                move = f"did you mean {close[0]}?" if close else known
                self.wrong(node, f"there is no function {name}: {move}")
        self.wrong(node, "no number and no value")

    def comparison(self, node: ast.Compare) -> Selection:
        operands = [node.left, *node.comparators]
        values = [self.value(each) for each in operands]
        parts = []
        for op, (left, right) in zip(node.ops, pairwise(values)):
            if type(op) not in _COMPARISONS:
                self.wrong(node, "compare with <, <=, >, >=, ==, !=")
            if left.number is not None and right.number is not None:
                self.wrong(node, f"compares two numbers: name a value, one of {', '.join(NAMED)}")
            parts.append(compare(left, _COMPARISONS[type(op)], right))
        return parts[0] if len(parts) == 1 else combined(np.logical_and.reduce, *parts)

    def number(self, node: ast.expr) -> float:
        found = self.value(node).number
        if found is None:
            self.wrong(node, "a plain number is needed here")
        return found

    def count(self, node: ast.expr) -> int:
        found = self.number(node)
        if not found.is_integer():
            self.wrong(node, "a whole number is needed here")
        return int(found)

    def string(self, node: ast.expr) -> str:
        match node:
            case ast.Constant(value=str(text)):
                return text
            case ast.Name(id=name) if name.startswith(_COLOR):
                return "#" + name.removeprefix(_COLOR)
        self.wrong(node, "a text in quotes is needed here")

    def truth(self, node: ast.expr) -> bool:
        match node:
            case ast.Constant(value=bool(truth)):
                return truth
        self.wrong(node, "True or False is needed here")

    def text_or_number(self, node: ast.expr) -> str | float:
        return self.string(node) if _is_text(node) else self.number(node)

    def amount(self, node: ast.expr) -> Amount:
        given = self.string(node) if _is_text(node) else str(self.count(node))
        try:
            return parse_amount(given)
        except UsageError as error:
            self.wrong(node, str(error))

    def call(self, node: ast.Call, name: str, function: Callable[..., Any]) -> Any:
        """Call a function of the expression with arguments read as its parameters' types say."""
        named = {each.arg: each.value for each in node.keywords if each.arg}
        try:
            if len(named) < len(node.keywords):
                raise TypeError("no ** here")
            bound = inspect.signature(function).bind(*node.args, **named).arguments
        except TypeError as error:
            self.wrong(node, f"{error}: write {_usage(name, function)}")
        parameters = inspect.signature(function).parameters
        positional, read = [], {}
        for each, given in bound.items():
            reader = ARGUMENTS[parameters[each].annotation]
            if parameters[each].kind is inspect.Parameter.VAR_POSITIONAL:
                positional = [*read.values(), *(reader(self, one) for one in given)]
                read = {}
            else:
                read[each] = reader(self, given)
        try:
            return function(*positional, **read)
        except UsageError as error:
            self.wrong(node, str(error))


ARGUMENTS: dict[str, Callable[[_Reader, ast.expr], Any]] = {
    "float": _Reader.number,
    "float | None": _Reader.number,
    "int": _Reader.count,
    "str": _Reader.string,
    "bool": _Reader.truth,
    "str | float": _Reader.text_or_number,
    "Amount": _Reader.amount,
    "Value": _Reader.value,
    "Selection": _Reader.selection,
}
"""How an argument is read, by the type of its parameter."""


def _is_text(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, str)


def _constant(number: float) -> Value:
    """One number, equal for all Gaussians."""
    return Value(lambda table: number, number)


def _depth(tree: ast.expr) -> int:
    """How many nodes are one inside the other."""
    depth, level = 0, [tree]  # level by level: a stack of calls would be as deep
    while level:
        depth += 1
        level = [child for node in level for child in ast.iter_child_nodes(node)]
    return depth


def _parses(source: str) -> bool:
    try:
        ast.parse(source, mode="eval")
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        return False
    return True


def _usage(name: str, function: Callable[..., Any]) -> str:
    """`sphere(x, y, z, radius)`; what may be left out is in brackets."""
    parameters = inspect.signature(function).parameters.values()
    words = [
        "..." if p.kind is p.VAR_POSITIONAL else p.name if p.default is p.empty else f"[{p.name}]"
        for p in parameters
    ]
    return f"{name}({', '.join(words)})"


# ---- what looks at a scene ----------------------------------------------------------------------


def questions(
    finder: Callable[[Gaussians], Any], tell: Callable[[Region], None] | None = None
) -> dict[str, Callable[..., Selection]]:
    """The functions of an expression that look at a scene, by name, for `gsedit.select.where`.

    `finder` makes the Finder of a scene, which is asked; `tell` is given what was found. Loads no
    torch before.
    """

    def ask(question: Callable[[Any], Region]) -> Selection:
        def mask(table: SplatTable) -> Bool[np.ndarray, " n"]:
            found = question(finder(gaussians_of(table)))
            if tell is not None:
                tell(found)
            return found.inside.numpy()

        # the scene is rendered
        return Selection(mask, whole=True, view_dependent=True, question=question)

    def subject(base: bool = False) -> Selection:
        return ask(lambda f: f.find_subject(base=base))

    def click(view: str, x: float, y: float, *more: str | float) -> Selection:
        told = (view, x, y, *more)
        clicks = [told[i : i + 3] for i in range(0, len(told), 3)]
        if any([*map(type, each)] != [str, float, float] for each in clicks):
            raise UsageError("click: give a view, a column and a row for each click")
        return ask(lambda f: f.find_clicked(clicks))

    def by_text(find: str) -> Callable[[str], Selection]:
        def answer(text: str) -> Selection:
            return ask(lambda f: getattr(f, find)(text))

        return answer

    texts = {"thing": "find_thing", "named": "find_named", "mask": "find_drawn"}
    told = {name: by_text(find) for name, find in {**texts, "flags": "find_flags"}.items()}
    return {"subject": subject, "click": click, **told}


def check_region(text: str, functions: Functions | None = None) -> Selection:
    """The rule of an expression or a short form, before any file is read. Raises UsageError.

    `functions` look at a scene; without them the rule is only checked, never asked.
    """
    try:
        return where(expression_of(text), functions or questions(lambda scene: None))
    except UsageError as error:
        if "(" in text or text.partition(":")[0] in NUMBERS:
            said = str(error)
            raise UsageError(said if said.startswith("region ") else f"region {said}") from None
        raise UsageError(f"region {text!r} is none that can be used: give {SHORT}") from None


# ---- short forms --------------------------------------------------------------------------------

SHORT = (
    "auto, all, box:x0,y0,z0,x1,y1,z1, sphere:x,y,z,r, a .npy file, a .png file, a folder, or an "
    "expression, as in thing('the red one')"
)
NUMBERS = {"box": 6, "sphere": 4}
"""Numbers of the volumes that have a short form."""
OUTSIDE = "not:"
"""Prefix of the view of a click that is not on the object."""
PLACE = re.compile(r"(?P<out>not:)?(?P<view>.+):(?P<x>\d+(\.\d*)?),(?P<y>\d+(\.\d*)?)")
"""A pixel of a view, for a person: [not:]VIEW:X,Y."""


def expression_of(region: str) -> str:
    """The expression that a short form means; another text is an expression already.

    Raises UsageError for a volume without its numbers.
    """
    if region in ("auto", "all"):
        return "subject()" if region == "auto" else "all()"
    shape, colon, rest = region.partition(":")
    if colon and shape in NUMBERS:
        return _volume(region, shape, rest)
    path = Path(region).expanduser()
    if path.suffix.lower() == ".npy":
        return f"flags({quoted(region)})"
    if path.suffix.lower() == ".png" or (region and path.is_dir()):
        return f"mask({quoted(region)})"
    return region


def _volume(region: str, shape: str, rest: str) -> str:
    try:
        numbers = [float(part) for part in rest.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != NUMBERS[shape] or not all(map(isfinite, numbers)):
        form = next(form for form in SHORT.split(", ") if form.startswith(shape))
        raise UsageError(f"region {region}: give {NUMBERS[shape]} finite numbers, as in {form}")
    if shape == "box":
        numbers = [choose(p) for choose in (min, max) for p in zip(numbers[:3], numbers[3:])]
    return f"{shape}({', '.join(map(repr, numbers))})"


def expression_of_clicks(places: Sequence[str]) -> str:
    """The expression of pixels as a person writes them, [not:]VIEW:X,Y. Raises UsageError."""
    told = (place_of(text) for text in places)
    return f"click({', '.join(f'{quoted(view)}, {x:g}, {y:g}' for view, x, y in told)})"


def place_of(text: str) -> tuple[str, float, float]:
    """The view, with OUTSIDE before it where the text has that, the column and the row of a pixel
    as a person writes it. Raises UsageError."""
    place = PLACE.fullmatch(text.strip())
    if place is None:
        raise UsageError(
            f"--at {text}: give a view, a column and a row, as in --at frame_00012.jpg:130,80, or "
            "not:... for a place that is not on it"
        )
    return (place["out"] or "") + place["view"], float(place["x"]), float(place["y"])


def quoted(text: str) -> str:
    """A text in the quotes of an expression, which has no escapes."""
    mark = '"' if "'" in text else "'"
    return mark + text.replace(mark, " ") + mark
