"""The program: its help, what it loads, completion in a shell, the terminal, and how it ends."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import warnings
from functools import cache
from typing import Any

import numpy as np
import pytest
from bad_files import BAD_FILES, PLY_COLUMNS, BadFile, ply_bytes, scene_table
from command_line import answer, files, gsedit, one_line, program
from gsedit_cli import main
from gsedit_cli.core.console import shown
from gsedit_cli.core.exits import Interrupted
from gsedit_cli.core.progress import NOTEBOOK, progress

from gsedit import Event
from gsedit.errors import GseditError, InputError, UsageError
from rasterizer import compiled

VERBS = (
    "app", "edit", "make", "capture", "fit", "info", "select", "view", "render", "mesh",
    "measure", "diff", "metrics", "convert", "filter", "clean", "decimate", "merge", "transform",
    "align", "recolor", "list", "mcp",
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


@cache
def every_command() -> dict[str, Any]:
    """Each verb as typer makes it, by the words that name it."""
    commands: dict[str, Any] = {}
    for verb, lazy in program().commands.items():
        command = lazy.make()
        commands[verb] = command
        for name, inner in getattr(command, "commands", {}).items():
            commands[f"{verb} {name}"] = inner
    return commands


@pytest.mark.parametrize("words", [*VERBS, "bench", *(f"bench {name}" for name in BENCHMARKS)])
def test_no_flag_is_cut_off_at_80_columns(words, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    text = gsedit(*words.split(), "--help" if words == "bench" else "--help-all").stdout
    assert max(map(len, text.splitlines())) <= 80
    options = [param for param in every_command()[words].params if param.opts[0].startswith("-")]
    shown = [option for option in options if not option.opts[0].startswith("--set.")]
    for flag in (flag for option in shown for flag in (*option.opts, *option.secondary_opts)):
        assert re.search(rf"(?<![\w-]){re.escape(flag)}(?![\w…-])", text), flag
    assert words == "bench" or "--threads" in text


def test_the_program_alone_says_what_it_has():
    assert set(every_command()) == {*VERBS, "bench", *(f"bench {name}" for name in BENCHMARKS)}
    assert re.fullmatch(r"gsedit \d+\.\d+\.\d+\S*\n", gsedit("--version").stdout)
    result = gsedit()
    assert result.exit_code == 2
    assert "view" in result.output
    assert "_GSEDIT_COMPLETE" in asked(_GSEDIT_COMPLETE="source_zsh")


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


CODE = "import sys; sys.argv = ['gsedit']; from gsedit_cli.main import main; main()"


def asked(**variables: str) -> str:
    """Ask as a shell does; return the answer."""
    done = subprocess.run(
        [sys.executable, "-c", CODE], env={**os.environ, **variables},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert not done.stderr
    return done.stdout


@pytest.mark.parametrize(
    ("words", "found"),
    [
        ("gsedit ed", ["edit"]),
        ("gsedit edit --se", ["--seed", "--set"]),
        ("gsedit fit photos --quality ", ["draft", "normal", "high"]),
    ],
)
def test_bash_is_told_what_may_follow(words, found):
    number = str(len(words.split(" ")) - 1)
    said = asked(COMP_WORDS=words, COMP_CWORD=number, _GSEDIT_COMPLETE="complete_bash")
    assert said.split() == found


@pytest.mark.parametrize(
    ("error", "code", "words"),
    [
        (UsageError("odd request"), 2, "odd request"),
        (InputError("odd file"), 3, "odd file"),
        (GseditError("odd"), 1, "odd"),
        (Interrupted("stopped at 3"), 130, "stopped at 3"),
        (KeyboardInterrupt(), 130, "interrupted"),
        (MemoryError(), 1, "--size"),
        (OSError(28, "No space left on device", "x.ply"), 1, "x.ply: No space left"),
        (ValueError("two\nlines"), 1, "ValueError: two lines); rerun with --debug"),
    ],
    ids=lambda value: type(value).__name__ if isinstance(value, BaseException) else None,
)
def test_every_error_is_one_line_and_its_code(monkeypatch, scene, error, code, words):
    def fail(*_, **__):
        raise error

    monkeypatch.setattr("gsedit.formats.files.open_scene", fail)
    result = gsedit("info", scene)
    assert result.exit_code == code
    assert one_line(result.stderr)
    assert words in result.stderr
    assert "Traceback" not in result.stderr
    assert result.stdout == ""


def test_debug_shows_the_traceback_and_the_line(tmp_path):
    result = gsedit("info", tmp_path / "none.ply", "--debug")
    assert result.exit_code == 3
    assert "Traceback" in result.stderr
    assert result.stderr.splitlines()[-1].startswith("gsedit: ")


@pytest.mark.parametrize("bad", BAD_FILES, ids=lambda bad: bad.name)
def test_bad_input_is_one_line_3_and_nothing_written(bad: BadFile, tmp_path):
    path = bad.build(tmp_path)
    before = files(tmp_path)
    out = tmp_path / "new"
    if bad.kind == "scene":
        result = gsedit("edit", path, "make it snow", "-o", out)
    else:
        result = gsedit("fit", path, "-o", out / "scene.ply", "--kernel", "torch")
    assert result.exit_code in (2, 3)
    assert one_line(result.stderr)
    for words in bad.words:
        assert words in result.stderr
    assert files(tmp_path) == before
    assert not out.exists()


def test_control_characters_are_shown_and_lines_stay_lines():
    assert shown("a\tb\nc é 世 \U0001f600") == "a\tb\nc é 世 \U0001f600"
    assert shown("\x1b[2J\x07\r\x9b\x7f") == "\\x1b[2J\\x07\\r\\x9b\\x7f"
    assert shown("\u202egnp.exe") == "\\u202egnp.exe"


def test_a_comment_of_a_scene_cannot_set_the_title(tmp_path):
    raw = ply_bytes(scene_table(), PLY_COLUMNS)
    raw = raw.replace(b"element vertex", b"comment \x1b]0;pwned\x07\nelement vertex", 1)
    (tmp_path / "a.ply").write_bytes(raw)
    done = gsedit("info", tmp_path / "a.ply")
    assert done.exit_code == 0
    assert "\\x1b]0;pwned\\x07" in done.stdout
    assert "\x1b" not in done.stdout + done.stderr


def test_warnings_of_libraries_are_not_printed(monkeypatch, capsys):
    monkeypatch.setattr(main, "app", lambda: warnings.warn("invalid value", stacklevel=1))
    monkeypatch.setattr(main.signal, "signal", lambda *_: None)
    with warnings.catch_warnings():
        warnings.resetwarnings()
        monkeypatch.setattr(main.sys, "warnoptions", [])
        main.main()
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize("is_notebook", [False, True])
def test_a_terminal_gets_bars_and_a_notebook_lines(capsys, monkeypatch, is_notebook):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    monkeypatch.delenv(NOTEBOOK, raising=False)
    if is_notebook:
        monkeypatch.setenv(NOTEBOOK, "1")
    with progress() as show:
        show(Event("fit", 0.0, 2, 2))
    assert ("[0 s] fit 2/2" in capsys.readouterr().err) == is_notebook


@pytest.fixture
def no_compiler(monkeypatch):
    monkeypatch.setenv("CXX", "/nowhere/c++")
    compiled.make.cache_clear()
    yield
    compiled.make.cache_clear()


def test_without_a_compiler_torch_renders_and_only_its_kernel_is_refused(
    no_compiler, scene, tmp_path
):
    words = ("render", scene, "--count", 1, "--size", 16)
    answer(*words, "-o", tmp_path / "a")
    refused = gsedit(*words, "-o", tmp_path / "b", "--kernel", "compiled")
    assert refused.exit_code == 2
    assert "CXX" in refused.stderr
    assert not (tmp_path / "b").exists()
