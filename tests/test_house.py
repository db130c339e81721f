"""The house stays readable: no circular import, few long functions, a cap on the whole."""

from __future__ import annotations

import ast
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
LONGEST_FUNCTION = 40
"""Lines, the docstring not counted."""
MOST = {
    "product": (("gsedit", "cli", "rasterizer"), 64_941, 367),
    "tests": (("tests",), 30_821, 284),
    "examples": (("examples",), 5_449, 41),
}
"""Lines and files of Python of the whole house: whoever wants a line finds one to give. These
numbers only ever fall."""
LONGER_FUNCTIONS = 6
LOOSE_FILES = 6
FOLDERS = 16
"""Folders of the package itself; theirs are not counted."""
PACKAGES = {"cli": "gsedit_cli", "gsedit": "gsedit", "rasterizer": "rasterizer"}


nodes = cache(lambda path: list(ast.walk(ast.parse(path.read_text()))))


def sources(*folders: str) -> list[Path]:
    return sorted(path for folder in folders for path in (ROOT / folder).rglob("*.py"))


def module_name(path: Path) -> str:
    folder, *parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join((PACKAGES[folder], *parts)).removesuffix(".__init__")


def imported(path: Path, modules: set[str]) -> set[str]:
    """The modules of ours that a file names in an import, at any depth of its code."""
    name = module_name(path)
    package = name if path.name == "__init__.py" else name.rpartition(".")[0]
    found = set()
    for node in nodes(path):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            above = package.split(".")[: 1 - node.level or None] if node.level else []
            base = ".".join((*above, *([node.module] if node.module else [])))
            names = {f"{base}.{alias.name}" for alias in node.names}
            found |= {each if each in modules else base for each in names}
    return (found & modules) - {name}


def test_no_import_runs_in_a_circle():
    paths = {module_name(path): path for path in sources(*PACKAGES)}
    graph = {name: imported(path, set(paths)) for name, path in paths.items()}
    assert graph["gsedit_cli.verbs.edit"]
    assert graph["gsedit.paper.strategies.single_pass"]
    list(TopologicalSorter(graph).static_order())  # raises CycleError, with the circle


@pytest.mark.parametrize("part", MOST)
def test_the_whole_house_is_capped(part):
    folders, lines, files = MOST[part]
    every = sources(*folders)
    assert sum(len(each.read_text().splitlines()) for each in every) <= lines
    assert len(every) <= files


def test_functions_are_short():
    long = []
    for path in sources("cli", "gsedit", "rasterizer", "tests", "examples"):
        for node in nodes(path):
            if isinstance(node, ast.FunctionDef):
                lines = (node.end_lineno or 0) - node.lineno + 1
                first = node.body[0]
                if ast.get_docstring(node) is not None:
                    lines -= (first.end_lineno or 0) - first.lineno + 1
                if lines > LONGEST_FUNCTION:
                    long.append(f"{path.relative_to(ROOT)}: {node.name}, {lines} lines")
    assert len(long) <= LONGER_FUNCTIONS, long


def test_the_package_has_few_loose_files_and_at_most_sixteen_folders():
    assert len(list((ROOT / "gsedit").glob("*.py"))) <= LOOSE_FILES
    assert len(list((ROOT / "gsedit").glob("*/__init__.py"))) <= FOLDERS
