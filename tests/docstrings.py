"""Lint of docstrings: each stands alone, with four words or more and a subject.

    python tests/docstrings.py gsedit rasterizer cli examples tests

Writes one line for each docstring that begins with a word that continues another sentence, or that
has fewer than four words. Exits with 1 where there is one.
"""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterator
from pathlib import Path

BAD_START = re.compile(r"(Of|The same|What|As of|As in|Where|Whose|Which|From now on)\b")
FEWEST_WORDS = 4
DEFINITIONS = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)


def docstrings(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """Line and text of every docstring in a module, also those below attributes and constants."""
    for node in ast.walk(tree):
        if isinstance(node, DEFINITIONS) and (text := ast.get_docstring(node)) is not None:
            yield node.body[0].lineno, text
        if not isinstance(node, (ast.Module, ast.ClassDef)):
            continue
        for before, after in zip(node.body, node.body[1:], strict=False):
            is_text = isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant)
            if isinstance(before, (ast.Assign, ast.AnnAssign)) and is_text:
                text = after.value.value
                if isinstance(text, str):
                    yield after.lineno, text


def complaint(text: str) -> str | None:
    """The reason why a docstring cannot be read on its own, or None."""
    if match := BAD_START.match(text.strip()):
        return f"begins with {match[0]!r}"
    words = len(text.split())
    return f"has {words} words" if words < FEWEST_WORDS else None


def main(folders: list[str]) -> int:
    """Write out the offending docstrings below the folders; 1 if there are any."""
    found = [
        f"{path}:{line}: {reason}: {text.strip().partition(chr(10))[0]}\n"
        for path in sorted(p for folder in folders for p in Path(folder).rglob("*.py"))
        for line, text in docstrings(ast.parse(path.read_text()))
        if (reason := complaint(text))
    ]
    sys.stderr.writelines(found)
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
