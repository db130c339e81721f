"""`import gsedit` is cheap, and its names are what they say, whatever is imported first."""

from __future__ import annotations

import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest


def python(code: str) -> subprocess.CompletedProcess[str]:
    """Run code in a fresh interpreter."""
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)


@pytest.mark.parametrize(
    "module",
    [
        "gsedit",
        "gsedit.errors",
        "gsedit.formats",
        "gsedit.paper.diffusion.settings",
        "gsedit.paper.settings",
        "gsedit.capture.fitting.settings",
        "gsedit.formats.registry",
        "rasterizer.numerics",
    ],
)
def test_light_modules_do_not_load_torch(module):
    done = python(f"import sys, {module}; assert not {{'torch', 'numpy'}} & set(sys.modules)")
    assert done.returncode == 0, done.stderr


AFRESH = """
import sys, torch
for code in sys.argv[1:]:
    for name in [each for each in sys.modules if each.split(".")[0] in ("gsedit", "rasterizer")]:
        del sys.modules[name]
    try:
        exec(code, {})
    except BaseException as error:
        raise RuntimeError(code) from error
"""


def in_turn(codes: list[str]) -> subprocess.CompletedProcess[str]:
    """Run some code after other; every time the tree is imported afresh, torch once."""
    return subprocess.run([sys.executable, "-c", AFRESH, *codes], capture_output=True, text=True)


def test_functions_are_what_they_are_called_in_any_order_of_imports():
    firsts = (
        "", "import gsedit.editing.edit, gsedit.capture.fitting.fit",
        "from gsedit import edit; import gsedit.editing.edit", "from gsedit import EditSettings",
    )  # fmt: skip
    edit = (
        "import sys, types, gsedit\n"
        "assert not {'open3d', 'pyvista', 'vtk'} & set(sys.modules)\n"
        "from gsedit import edit\n"
        "assert isinstance(edit, types.FunctionType), edit\n"
        "assert gsedit.edit is edit\n"
        "from gsedit.editing.edit import edit_steps\n"
        "assert isinstance(sys.modules['gsedit.editing.edit'], types.ModuleType)\n"
        "assert edit_steps is gsedit.edit_steps\n"
    )
    render = (
        "import types, rasterizer\n"
        "from rasterizer import rasterization, render\n"
        "assert isinstance(render, types.FunctionType), render\n"
        "assert isinstance(rasterization, types.FunctionType), rasterization\n"
        "from rasterizer.render import render as same\n"
        "assert rasterizer.render is same is render\n"
    )
    before = "import rasterizer.render, rasterizer.rasterization"
    done = in_turn([*(f"{each}\n{edit}" for each in firsts), render, f"{before}\n{render}"])
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    "package", ["gsedit", "gsedit.paper.editors", "gsedit.toolkit", "gsedit.select", "rasterizer"]
)
def test_public_names_are_those_imported_for_type_checkers(package):
    module = import_module(package)
    assert module.__all__
    for name in module.__all__:
        assert name in dir(module)
        assert hasattr(module, name)
    assert f"{module._homes[module.__all__[0]]} import" in Path(module.__file__).read_text()
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        _ = module.nonsense


def test_to_read_and_paint_loads_no_compiler_of_torch():
    done = python(
        "import sys; from gsedit.paper.editors import make_editor; make_editor()\n"
        "from gsedit.words.read import read_instruction; read_instruction('like Van Gogh')\n"
        "assert not {'torch._dynamo', 'sympy'} & set(sys.modules)\n"
    )
    assert done.returncode == 0, done.stderr
