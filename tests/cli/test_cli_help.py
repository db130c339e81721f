"""Help, version, and what light commands load."""

from __future__ import annotations

import re
import subprocess
import sys
from typing import Any

import numpy as np
import pytest
import typer
from command_line import answer, gsedit
from gsedit_cli.main import app

VERBS = (
    "app", "edit", "make", "style", "capture", "fit", "info", "select", "view", "render", "mesh",
    "measure", "diff", "metrics", "convert", "filter", "clean", "decimate", "merge", "transform",
    "bend", "align", "recolor", "list", "doctor", "mcp",
)  # fmt: skip
HEAVY = {
    "jaxtyping", "kornia", "matplotlib", "numpy", "open3d", "pi_heif", "PIL", "pycolmap", "pyvista",
    "safetensors", "scipy", "torch", "trimesh", "viser", "zstandard",
}  # fmt: skip
"""Modules that no help may load: a shell asks for it at every Tab; who builds a wheel has none."""
BENCHMARKS = ("targets", "stability")


def test_help_loads_nothing_heavy():
    code = (
        "import contextlib, io, sys\n"
        "from gsedit_cli.main import app\n"
        f"for words in [[], *([verb] for verb in {VERBS})]:\n"
        "    with contextlib.suppress(SystemExit), contextlib.redirect_stdout(io.StringIO()):\n"
        "        app([*words, '--help'])\n"
        f"sys.exit(', '.join({HEAVY} & set(sys.modules)) or 0)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_the_list_of_verbs_is_one_screen(monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    text = gsedit("--help").stdout
    assert len(text.splitlines()) <= 50
    for verb in (*VERBS, "bench"):
        assert re.search(rf"^  {verb} +[A-Z]", text, re.MULTILINE)
    assert len(VERBS) + 1 <= 27


@pytest.mark.parametrize("verb", VERBS)
def test_the_help_of_a_verb_is_one_screen_with_an_example(verb, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    result = gsedit(verb, "--help")
    assert result.exit_code == 0
    assert f"gsedit {verb} " in result.stdout
    lines = result.stdout.splitlines()
    assert len(lines) <= (60 if verb == "edit" else 50)
    assert sum(line.startswith("  -") for line in lines) <= 15
    for option in ("--set", "--help-all"):
        assert option in result.stdout


@pytest.mark.parametrize("verb", VERBS)
def test_all_options_are_listed_on_request(verb):
    text = gsedit(verb, "--help-all").stdout
    for option in ("--json", "--debug", "--threads", *HIDDEN.get(verb, ())):
        assert re.search(rf"(?<![\w-]){option}(?![\w-])", text), option


HIDDEN = {
    "edit": ("--patches", "--timeout", "--features", "--from"),
    "fit": ("--densify-every", "--kernel"),
    "render": ("--crf", "--kernel", "--fps"),
    "transform": ("--quat", "--center", "--data"),
    "recolor": ("--hue", "--opacity-scale"),
}
"""Some options that only --help-all lists, by verb."""


def every_command() -> dict[str, Any]:
    """Each verb as typer makes it, by the words that name it."""
    commands: dict[str, Any] = {}
    program: Any = typer.main.get_command(app)
    for verb, lazy in program.commands.items():
        command = lazy.make()
        commands[verb] = command
        for name, inner in getattr(command, "commands", {}).items():
            commands[f"{verb} {name}"] = inner
    return commands


@pytest.mark.parametrize("words", [*VERBS, "bench", *(f"bench {name}" for name in BENCHMARKS)])
def test_no_flag_is_cut_off_at_80_columns(words, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    text = gsedit(*words.split(), "--help" if "bench" in words else "--help-all").stdout
    assert max(map(len, text.splitlines())) <= 80
    options = [param for param in every_command()[words].params if param.opts[0].startswith("-")]
    for flag in (flag for option in options for flag in (*option.opts, *option.secondary_opts)):
        assert re.search(rf"(?<![\w-]){re.escape(flag)}(?![\w…-])", text), flag


def test_every_verb_is_tested():
    assert set(every_command()) == {*VERBS, "bench", *(f"bench {name}" for name in BENCHMARKS)}


def test_version():
    assert re.fullmatch(r"gsedit \d+\.\d+\.\d+\S*\n", gsedit("--version").stdout)


def test_no_verb_shows_the_help_and_is_2():
    result = gsedit()
    assert result.exit_code == 2
    assert "view" in result.output


LIGHT = (
    ("info", "scene.ply"),
    ("convert", "scene.ply", "--sh-degree", "0", "-o", "a.ply"),
    ("convert", "scene.ply", "a.compressed.ply"),
    ("filter", "scene.ply", "--region", "all.npy", "--where",
     "z < 99 and (opacity > 0 or near(#a08050, 10))", "-o", "a.ply"),
)  # fmt: skip
"""Commands that start in a fraction of a second."""


@pytest.mark.parametrize("words", LIGHT, ids=lambda words: words[0])
def test_light_commands_load_nothing_heavy(words, scene, tmp_path):
    np.save(tmp_path / "all.npy", np.ones(5, bool))
    heavy = {"torch", "scipy", "numba", "matplotlib", "gsply", "PIL", "trimesh", "open3d"}
    code = (
        "import sys; from gsedit_cli.main import app\n"
        "try: app()\nexcept SystemExit as end: assert not end.code, end.code\n"
        f"sys.exit(', '.join({heavy} & set(sys.modules)) or 0)"
    )
    command = [sys.executable, "-c", code, *words]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_core_commands_do_without_the_viewers(scene, tmp_path, monkeypatch):
    for name in ("open3d", "pyvista", "vtk"):
        monkeypatch.setitem(sys.modules, name, None)
    for words in (("info",), ("render", "--count", 1, "--size", 16, "-o", tmp_path / "out")):
        answer(words[0], scene, *words[1:])
    assert (tmp_path / "out/view_000.png").exists()
