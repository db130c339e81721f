"""The commands that trained `small` are those of their README; no product code imports research."""

from __future__ import annotations

import ast
import re
from importlib import import_module
from pathlib import Path

import pytest
from research.train_small.make_pictures import make_pictures
from research.train_small.picture_cache import Chunk

ROOT = Path(__file__).parents[2]
README = (ROOT / "examples/research/train_small/README.md").read_text()
COMMANDS = re.findall(r"python -m (research\.train_small\.\w+)", README)


def test_the_readme_lists_three_commands():
    assert COMMANDS == [
        "research.train_small.make_pictures",
        "research.train_small.train",
        "research.train_small.score",
    ]


@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_prints_its_help(name, capsys):
    with pytest.raises(SystemExit) as ended:
        import_module(name).main(["--help"])
    assert ended.value.code == 0
    assert f"usage: {name}" in capsys.readouterr().out


def test_files_in_the_readme_exist():
    names = re.findall(r"`(\w+\.py)`", README)
    assert "recipe.py" in names
    assert all((ROOT / "examples/research/train_small" / name).exists() for name in names)


def test_make_pictures_leaves_them_in_the_folder(tmp_path, capsys):
    make_pictures(tmp_path, [Chunk(7, 16, 2, 1)])
    assert capsys.readouterr().out.startswith("3 pictures in ")
    assert [path.name for path in (tmp_path / "pictures").iterdir()] == ["7_16_2_1.safetensors"]


def test_the_product_imports_no_research_and_no_mocks():
    for folder in ("gsedit", "cli", "rasterizer"):
        for path in (ROOT / folder).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text())):
                modules = [getattr(node, "module", None) or ""]
                if isinstance(node, ast.Import):
                    modules = [alias.name for alias in node.names]
                assert not any(name.startswith(("research", "unittest")) for name in modules), path
