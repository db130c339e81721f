"""A wheel holds every package of the tree, what it reads at run time, and nothing else."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

from gsedit.errors import GseditError
from gsedit.run.environment import EXTRAS, load_extra

ROOT = Path(__file__).parents[1]


def table(text: str, name: str) -> str:
    """The lines of a table of pyproject.toml (tomllib came with Python 3.11)."""
    return text.split(f"[{name}]\n")[1].split("\n[")[0]


def strings(text: str) -> list[str]:
    return re.findall(r'"([^"]+)"', re.sub(r"#.*", "", text))


@pytest.fixture(scope="module")
def pyproject() -> str:
    return (ROOT / "pyproject.toml").read_text()


def test_the_list_of_packages_is_that_of_the_folders(pyproject):
    folders = [
        path.parent.relative_to(ROOT)
        for package in ("cli", "gsedit", "rasterizer")
        for path in (ROOT / package).rglob("__init__.py")
    ]
    names = {".".join(folder.parts) for folder in folders}
    names = {re.sub(r"^cli\b", "gsedit_cli", name) for name in names}
    listed = strings(table(pyproject, "tool.setuptools"))
    assert set(listed) == names
    assert len(listed) == len(set(listed))
    assert not any("research" in name for name in listed)
    assert 'gsedit_cli = "cli"' in table(pyproject, "tool.setuptools.package-dir")


def test_every_file_that_is_no_module_is_package_data(pyproject):
    tracked = subprocess.run(
        ["git", "-C", str(ROOT), "ls-files", "gsedit", "rasterizer", "cli"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    if tracked.returncode:
        pytest.skip("not a git checkout")
    data = {name for name in tracked.stdout.split() if not name.endswith(".py")}
    declared = set()
    for line in table(pyproject, "tool.setuptools.package-data").strip().splitlines():
        package, *files = strings(line)
        declared |= {f"{package.replace('.', '/')}/{file}" for file in files}
    assert declared == data
    assert {Path(name).name for name in data} >= {
        "chunk.h", "kernel.cpp", "simd.h", "photometric.cpp", "adam.cpp",
        "styles.safetensors", "MODEL_CARD.md",
    }  # fmt: skip


def test_an_error_names_the_extra_that_brings_the_package(pyproject):
    extras = table(pyproject, "project.optional-dependencies")
    for package, extra in EXTRAS.items():
        brought = re.search(rf"^{extra} = \[(.*?)\]", extras, re.MULTILINE | re.DOTALL)
        assert brought, extra
        assert package in brought[1]
    everything = re.search(r"^all = \[\"gsedit\[(.*)\]\"\]", extras, re.MULTILINE)
    assert everything
    named = set(re.findall(r"^(\w+) = \[", extras, re.MULTILINE))
    assert set(everything[1].split(",")) == named - {"all", "dev", "docs"}
    with pytest.raises(
        GseditError, match=r"^a thing needs av \(.*\): pip install 'gsedit\[video\]'"
    ):
        load_extra("av.nothing_of_this_name", "a thing")
