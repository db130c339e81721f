"""Help, version, and requests that make no sense."""

from __future__ import annotations

import re
import subprocess
import sys
from typing import Any

import pytest
import typer
from command_line import files, gsedit, one_line
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
BENCHMARKS = ("stability", "targets", "edit")


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


def test_a_wrong_choice_is_explained_in_plain_words(tmp_path):
    words = ("edit", "a.ply", "snow", "-o", tmp_path / "out", "--strategy", "throwaway")
    message = gsedit(*words).stderr
    assert "'--strategy': 'throwaway' is not one of 'combined', " in message
    assert "Value error" not in message


def test_version():
    assert re.fullmatch(r"gsedit \d+\.\d+\.\d+\S*\n", gsedit("--version").stdout)


@pytest.mark.parametrize(
    "words",
    [
        ["nonsense"],
        ["--nonsense"],
        ["info"],
        ["info", "a.ply", "b.ply"],
        ["fit", "photos"],
        ["fit", "photos", "-o", "a.ply", "--steps", "many"],
        ["edit", "a.ply", "make it snow", "-o", "out", "--geometry", "none"],
        ["render", "a.ply", "-o", "out", "--views", "0,8"],
        ["render", "a.ply", "-o", "out", "--data", "d", "--views", "0,eight"],
        ["view", "a.ply", "-o", "a.jpg"],
        ["view", "a.ply", "-o", "a.png", "--up", "w"],
    ],
    ids=" ".join,
)
def test_a_request_that_makes_no_sense_is_one_line_and_2(words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = gsedit(*words)
    assert result.exit_code == 2
    assert one_line(result.stderr)
    assert result.stdout == ""
    assert not files(tmp_path)


def test_no_verb_shows_the_help_and_is_2():
    result = gsedit()
    assert result.exit_code == 2
    assert "view" in result.output
