"""Imports point down: cli -> gsedit -> rasterizer -> torch, and within a folder down the list."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]

# Each room may import only rooms further down its list.
ORDER = {
    "gsedit": (
        "mcp_server",
        "app",
        "editing",
        "bench",
        "paper",
        "capture",
        "mesh",
        "pictures",
        "change",
        "toolkit",
        "measures",
        "select",
        "words",
        "views",
        "formats",
        "scene",
        "run",
        "errors",
    ),
    "rasterizer": (
        "reference", "rasterization",
        "render", "color_weights",
        "cpp_projection", "splat",
        "preprocess", "checks",
        "blending", "tiles", "project", "harmonics", "camera", "scene", "notebook",
        "compiled", "numerics", "lazy", "compiler",
    ),
}  # fmt: skip
BELOW = {"cli": ("gsedit", "rasterizer"), "gsedit": ("rasterizer",), "rasterizer": ()}
FOREIGN = ("unittest", "pytest", "bench", "research", "tests")


def imports(path: Path) -> list[str]:
    """Absolute names of everything a file imports, at any depth of its code."""
    names = []
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names += [f"{node.module}.{alias.name}" for alias in node.names]
    return names


def offences(folder: str, path: Path, names: list[str]) -> list[str]:
    """Imports that point up, of a file in a top-level folder."""
    packages = {"cli": "gsedit_cli"}
    own = packages.get(folder, folder)
    wrong = []
    for name in names:
        top, *rest = name.split(".")
        if (
            top in ("gsedit_cli", "gsedit", "rasterizer")
            and top != own
            and top not in BELOW[folder]
        ):
            wrong.append(name)
        order = ORDER.get(folder, ())
        here = path.relative_to(ROOT / folder).parts[0].removesuffix(".py")
        listed = top == own and here in order and rest and rest[0] in order
        if listed and order.index(rest[0]) < order.index(here):
            wrong.append(name)
    return wrong


@pytest.mark.parametrize("folder", ["cli", "gsedit", "rasterizer"])
def test_imports_point_down(folder):
    files = sorted((ROOT / folder).rglob("*.py"))
    assert files
    wrong = {str(p): bad for p in files if (bad := offences(folder, p, imports(p)))}
    assert not wrong


@pytest.mark.parametrize("folder", ["cli", "gsedit", "rasterizer"])
def test_the_product_imports_neither_mocks_nor_the_laboratory(folder):
    files = sorted((ROOT / folder).rglob("*.py"))
    wrong = {str(p): name for p in files for name in imports(p) if name.split(".")[0] in FOREIGN}
    assert not wrong


@pytest.mark.parametrize("folder", ["gsedit", "rasterizer"])
def test_every_module_has_its_place(folder):
    inside = [p for p in (ROOT / folder).iterdir() if p.is_dir() or p.suffix == ".py"]
    modules = {p.name.removesuffix(".py") for p in inside if p.name[0] != "_"}
    assert modules == set(ORDER[folder])
