"""Selections as expressions: `opacity > 0.1 and not sphere(0, 0, 0, 1) or near(#a08050, 10)`.

The grammar is that of Python's expressions, cut down: comparisons of values (`NAMED`, extra
columns, numbers, + - * / **, `VALUES`), the functions of `SELECTIONS`, and, or, not. Python parses
the text; nothing of it is evaluated but what is listed here.
"""

from __future__ import annotations

import ast
import inspect
import operator
import re
from collections.abc import Callable, Mapping
from difflib import get_close_matches
from itertools import pairwise
from typing import Any, NoReturn

import numpy as np

from gsedit.errors import UsageError
from gsedit.select.clusters import cluster, cluster_at, grow, shrink
from gsedit.select.rules import (
    FORMS,
    NAMED,
    VALUES,
    Amount,
    Selection,
    Value,
    combined,
    compare,
    computed,
    parse_amount,
    value_named,
)

SELECTIONS: dict[str, Callable[..., Selection]] = {
    **FORMS,
    **{form.__name__: form for form in (cluster, cluster_at, grow, shrink)},
}
"""Functions by their names in expressions."""
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
DEEPEST = 100
"""Nodes of an expression that are one inside the other: Python's stack holds their evaluation."""
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


Functions = Mapping[str, Callable[..., Selection]]
"""Functions of an expression by name; the types of their parameters say how to read arguments."""


def where(text: str, functions: Functions | None = None) -> Selection:
    """Return the selection of an expression, which may call `functions` besides `SELECTIONS`.

    A function replaces one of the same name. Raises UsageError, which quotes the wrong place.
    """
    return _Reader(text, functions or {}).read()


class _Reader:
    """One expression while it is read."""

    def __init__(self, text: str, functions: Functions) -> None:
        self.selections = {**SELECTIONS, **functions}
        self.text = " ".join(text.split("\n")).strip()
        self.source = _QUOTED_OR_COLOR.sub(
            lambda match: _COLOR if match[0] == "#" else match[0], self.text
        )

    def read(self) -> Selection:
        return self.selection(self.tree())

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
        if _depth(tree) > DEEPEST:
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
        match node:
            case ast.BoolOp(op=op, values=values):
                parts = tuple(self.selection(each) for each in values)
                join = np.logical_and if isinstance(op, ast.And) else np.logical_or
                return combined(join.reduce, *parts)
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                return ~self.selection(operand)
            case ast.Compare():
                return self.comparison(node)
            case ast.Call(func=ast.Name(id=name)) if name in self.selections:
                return self.call(node, self.selections[name])
            case ast.Name(id=name) if name in self.selections:
                self.wrong(node, f"write {_usage(name, self.selections[name])}")
            case ast.Call(func=ast.Name(id=name)) if name not in VALUES:
                self.unknown(node, name, [*self.selections, *VALUES], "function")
        self.value(node)  # what is wrong inside is told first
        self.wrong(node, "a number where a condition is needed: compare it, as in opacity > 0.1")

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

    def value(self, node: ast.expr) -> Value:
        match node:
            case ast.Constant(value=int() | float()) | ast.UnaryOp(op=ast.USub() | ast.UAdd()):
                return self.signed(node)
            case ast.Name(id=name) if name in _CONSTANTS:
                return _constant(_CONSTANTS[name])
            case ast.Name(id=name) if name in self.selections:
                self.wrong(node, "a condition where a number is needed")
            case ast.Name(id=name) if name in VALUES:
                self.wrong(node, f"write {_usage(name, VALUES[name])}")
            case ast.Name(id=name):
                return value_named(name)  # perhaps an extra column of the file
            case ast.BinOp(left=left, op=op, right=right) if type(op) in _OPERATORS:
                a, b = self.value(left), self.value(right)
                return computed(_OPERATORS[type(op)], a, b)
            case ast.BinOp(op=ast.BitAnd() | ast.BitOr()) | ast.UnaryOp(op=ast.Invert()):
                self.wrong(node, "write and, or, not for &, |, ~")
            case ast.Call(func=ast.Name(id=name)) if name in VALUES:
                return self.call(node, VALUES[name])
            case ast.Call(func=ast.Name(id=name)) if name not in self.selections:
                self.unknown(node, name, [*VALUES, *self.selections], "function")
            case ast.Call(func=ast.Name()):
                self.wrong(node, "a condition where a number is needed")
        kind = isinstance(node, ast.BoolOp | ast.Compare | ast.UnaryOp)
        problem = "a condition where a number is needed" if kind else "no number and no value"
        self.wrong(node, problem)

    def signed(self, node: ast.expr) -> Value:
        match node:
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                inner = self.value(operand)
                if inner.number is not None:
                    return _constant(-inner.number)
                return computed(operator.sub, _constant(0.0), inner)
            case ast.UnaryOp(op=ast.UAdd(), operand=operand):
                return self.value(operand)
            case ast.Constant(value=number) if not isinstance(number, bool):
                try:
                    return _constant(float(number))  # pyright: ignore[reportArgumentType]
                except OverflowError:
                    self.wrong(node, "too large a number")
        self.wrong(node, "no number")

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

    def call(self, node: ast.Call, function: Callable[..., Any]) -> Any:
        """Call a function of the expression with arguments read as its parameters' types say."""
        name = node.func.id  # pyright: ignore[reportAttributeAccessIssue]
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

    def unknown(self, node: ast.expr, name: str, known: list[str], what: str) -> NoReturn:
        close = get_close_matches(name, known, 1)
        move = f"did you mean {close[0]}?" if close else f"there are {', '.join(known)}"
        self.wrong(node, f"there is no {what} {name}: {move}")


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
