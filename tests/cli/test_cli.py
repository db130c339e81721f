"""The command line: what goes to which stream, which exit code, and that nothing is ever lost."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
import torch
from bad_files import BAD_FILES, BadFile, dataset, ply_bytes, scene_table
from gsedit_cli import main as cli
from gsedit_cli.edit_options import Preset, RoundOptions, SamplerOptions, UpdateOptions, resolve
from gsedit_cli.exits import Interrupted
from gsedit_cli.progress import plain_line, progress
from PIL import Image
from typer.testing import CliRunner

from gsedit.diffusion import SamplerDefaults, SamplerSettings
from gsedit.editors.small import DEFAULTS
from gsedit.errors import GseditError, InputError, UsageError
from gsedit.files import load
from gsedit.fitting.fit import FitResult
from gsedit.fitting.update import UpdateSettings
from gsedit.reports.events import Checkpoint, Event
from gsedit.reports.journal import read_events
from gsedit.session.settings import EditSettings
from gsedit.strategies.single_pass import SinglePass

VERBS = ("fit", "edit", "render", "preview", "info", "editors", "doctor")


@pytest.fixture
def scene(tmp_path) -> Path:
    """A scene file of five random Gaussians."""
    path = tmp_path / "scene.ply"
    path.write_bytes(ply_bytes(scene_table()))
    return path


@pytest.fixture
def photos(tmp_path) -> Path:
    """A dataset of three photos of 8 x 6 pixels."""
    dataset(tmp_path / "photos")
    return tmp_path / "photos"


def gsedit(*words: object):
    return CliRunner().invoke(cli.app, [str(word) for word in words])


def files(folder: Path) -> dict[Path, bytes]:
    return {p: p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def one_line(text: str) -> bool:
    return text.count("\n") == 1 and text.endswith("\n")


# ---- help, version, usage ------------------------------------------------------------------------


def test_help_of_every_verb_loads_nothing_heavy():
    code = (
        "import contextlib, io, sys\n"
        "from gsedit_cli.main import app\n"
        f"for words in [[], *([verb] for verb in {VERBS})]:\n"
        "    with contextlib.suppress(SystemExit), contextlib.redirect_stdout(io.StringIO()):\n"
        "        app([*words, '--help'])\n"
        "heavy = {'torch', 'numpy', 'open3d', 'pyvista', 'matplotlib', 'kornia', 'PIL'}\n"
        "sys.exit(', '.join(heavy & set(sys.modules)) or 0)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("verb", VERBS)
def test_help_shows_an_example_and_the_common_options(verb):
    result = gsedit(verb, "--help")
    assert result.exit_code == 0
    assert f"gsedit {verb} " in result.stdout
    for option in ("--json", "--debug", "--threads"):
        assert option in result.stdout


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
        ["preview", "a.ply", "-o", "a.jpg"],
        ["preview", "a.ply", "-o", "a.png", "--up", "w"],
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
    assert "preview" in result.output


# ---- errors --------------------------------------------------------------------------------------


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

    monkeypatch.setattr("gsedit.files.read_scene", fail, raising=False)
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
        result = gsedit("fit", path, "-o", out / "scene.ply")
    assert result.exit_code in (2, 3)
    assert one_line(result.stderr)
    for words in bad.words:
        assert words in result.stderr
    assert files(tmp_path) == before
    assert not out.exists()


@pytest.mark.parametrize(
    ("instruction", "editor"),
    [("", "small"), ("  ", "small"), ("snow " * 25, "small"), ("blorp the zizzle", "closed-form")],
)
def test_an_instruction_nobody_can_follow_is_2(scene, tmp_path, instruction, editor):
    result = gsedit("edit", scene, instruction, "-o", tmp_path / "out", "--editor", editor)
    assert result.exit_code == 2
    assert one_line(result.stderr)
    assert not (tmp_path / "out").exists()


# ---- outputs are never overwritten by accident ---------------------------------------------------


@pytest.mark.parametrize("verb", ["fit", "edit", "render", "preview"])
def test_an_output_that_exists_is_refused_before_any_work(verb, scene, photos, tmp_path):
    file, folder = tmp_path / "taken.ply", tmp_path / "taken"
    file.write_text("mine")
    (tmp_path / "taken.png").write_text("mine")
    folder.mkdir()
    (folder / "note").write_text("mine")
    before = files(tmp_path)
    words = {
        "fit": ["fit", photos, "-o", file],
        "edit": ["edit", scene, "make it snow", "-o", folder],
        "render": ["render", scene, "-o", folder],
        "preview": ["preview", scene, "-o", tmp_path / "taken.png"],
    }[verb]
    result = gsedit(*words)
    assert result.exit_code == 2
    assert one_line(result.stderr)
    assert "-f" in result.stderr
    assert files(tmp_path) == before


def test_an_output_below_a_file_is_refused(scene, photos):
    for words in (["fit", photos, "-o", scene / "a.ply"], ["render", scene, "-o", scene / "a"]):
        result = gsedit(*words)
        assert result.exit_code == 2
        assert one_line(result.stderr)


# ---- info and render -----------------------------------------------------------------------------


def test_info_tells_what_the_file_holds(scene):
    record = json.loads(gsedit("info", scene, "--json").stdout)
    means = load(scene).means
    assert record["gaussians"] == 5
    assert record["sh_degree"] == 1
    assert record["bytes"] == scene.stat().st_size
    assert [record[axis][0] for axis in "xyz"] == means.amin(0).tolist()
    assert [record[axis][-1] for axis in "xyz"] == means.amax(0).tolist()
    text = gsedit("info", scene)
    assert text.exit_code == 0
    assert text.stderr == ""
    assert len(text.stdout.splitlines()) == 9


def test_drop_invalid_says_what_it_dropped(tmp_path):
    table = scene_table()
    table[1, 0] = float("nan")
    path = tmp_path / "holes.ply"
    path.write_bytes(ply_bytes(table))
    assert gsedit("info", path).exit_code == 3
    result = gsedit("info", path, "--drop-invalid", "--json")
    assert json.loads(result.stdout)["gaussians"] == 4
    assert "1 of 5" in result.stderr


def test_render_writes_what_it_lists(scene, photos, tmp_path):
    out = tmp_path / "out"
    words = ["render", scene, "--data", photos, "--views", "0,2", "--depth", "-o", out, "--json"]
    result = gsedit(*words)
    assert result.exit_code == 0, result.stderr
    lines = [json.loads(line) for line in result.stdout.splitlines()]
    listed = {Path(line["picture"]) for line in lines if line["type"] == "result"}
    assert listed == set(files(out))
    ends = ("000_0.png", "000_0.depth.npy", "000_0.depth.png")
    assert {out / end for end in ends} < listed
    assert len(listed) == 6
    assert gsedit("render", scene, "--data", photos, "--views", "3", "-o", out, "-f").exit_code == 2


def test_render_places_cameras_where_there_are_none(scene, tmp_path):
    result = gsedit("render", scene, "--count", 2, "--size", 16, "-o", tmp_path / "out")
    assert result.exit_code == 0, result.stderr
    pictures = [tmp_path / "out" / f"orbit_{i:03d}.png" for i in range(2)]
    assert result.stdout.split() == [str(path) for path in pictures]
    assert set(files(tmp_path / "out")) == set(pictures)


@pytest.mark.filterwarnings("ignore:.*without the compiled kernel")
def test_compile_draws_the_same_pictures(scene, tmp_path):
    for words in ([], ["--compile"]):
        out = tmp_path / f"out{len(words)}"
        result = gsedit("render", scene, "--count", 1, "--size", 32, "-o", out, *words)
        assert result.exit_code == 0, result.stderr
    a, b = (decode(tmp_path / f"out{i}" / "orbit_000.png") for i in (0, 1))
    assert (a - b).abs().max() <= 1  # rounding may fall to either side


def decode(path: Path) -> torch.Tensor:
    return torch.from_numpy(np.asarray(Image.open(path)).astype(int))


# ---- fit: events, checkpoints, interruption ------------------------------------------------------


def stub_fit(monkeypatch, *, end: BaseException | None = None, checkpoints: int = 1):
    """Replace the fit by one that yields an event, checkpoints, and then a result or an error."""
    given = {}

    def fit_steps(dataset, settings, *, generator, start=None):
        given.update(settings=settings, start=start, seed=generator.initial_seed())
        result = load_stub()
        yield Event("fit", 1.0, 1, 2, 0.5, 0.1)
        for step in range(1, checkpoints + 1):
            yield Checkpoint(result, 10 * step, 1.5)
        if end is not None:
            raise end
        yield FitResult(result, 20.0, 2, 2.0, ((2.0, 20.0),))

    # not by dotted name: gsedit.fit is also the function of that name
    monkeypatch.setattr(import_module("gsedit.fitting.fit"), "fit_steps", fit_steps)
    return given


def load_stub():
    from rasterizer.scene import Gaussians

    n = 3
    quats = torch.tensor([1.0, 0, 0, 0]).repeat(n, 1)
    zeros = torch.zeros(n, 3)
    return Gaussians(zeros, quats, zeros, torch.zeros(n), torch.zeros(n, 1, 3))


def test_fit_writes_the_scene_and_removes_its_checkpoint(monkeypatch, photos, tmp_path):
    given = stub_fit(monkeypatch)
    out = tmp_path / "scene.ply"
    result = gsedit("fit", photos, "-o", out, "--minutes", 2, "--seed", 7, "--json")
    assert result.exit_code == 0, result.stderr
    event, record = (json.loads(line) for line in result.stdout.splitlines())
    assert event["type"] == "event"
    assert record == {
        "type": "result", "scene": str(out), "gaussians": 3, "psnr": 20.0,
        "steps": 2, "seconds": 2.0, "curve": [[2.0, 20.0]],
    }  # fmt: skip
    assert given["settings"].seconds == 120
    assert given["settings"].steps is None
    assert not given["settings"].execution.compile
    assert given["seed"] == 7
    assert len(load(out)) == 3
    assert set(files(tmp_path)) - set(files(photos)) == {out}
    assert "gsedit preview" in result.stderr


@pytest.mark.parametrize("end", [KeyboardInterrupt(), RuntimeError("bug"), MemoryError()])
def test_an_ended_fit_leaves_its_last_checkpoint_and_says_where(monkeypatch, photos, tmp_path, end):
    stub_fit(monkeypatch, end=end, checkpoints=2)
    out, checkpoint = tmp_path / "scene.ply", tmp_path / "scene.checkpoint.ply"
    result = gsedit("fit", photos, "-o", out)
    assert result.exit_code == (130 if isinstance(end, KeyboardInterrupt) else 1)
    assert f"last complete checkpoint is {checkpoint} (step 20)" in result.stderr
    assert f"--from {checkpoint}" in result.stderr
    assert len(load(checkpoint)) == 3
    assert not out.exists()

    stub_fit(monkeypatch)  # a second run does not write over it unasked
    forgotten = gsedit("fit", photos, "-o", out)
    assert forgotten.exit_code == 2
    assert "--from" in forgotten.stderr
    given = stub_fit(monkeypatch)
    assert gsedit("fit", photos, "-o", out, "--from", checkpoint).exit_code == 0
    assert len(given["start"]) == 3
    assert not checkpoint.exists()


def test_interrupted_before_the_first_checkpoint(monkeypatch, photos, tmp_path):
    stub_fit(monkeypatch, end=KeyboardInterrupt(), checkpoints=0)
    result = gsedit("fit", photos, "-o", tmp_path / "scene.ply")
    assert result.exit_code == 130
    assert result.stderr.splitlines()[-1].startswith("gsedit: interrupted; no checkpoint")
    assert set(files(tmp_path)) == set(files(photos))


@pytest.mark.parametrize("stop", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.skipif(os.name == "nt", reason="Windows has no such signals")
def test_a_signal_ends_a_real_process_as_ctrl_c_does(photos, tmp_path, stop):
    code = (
        "import sys, time\n"
        "from importlib import import_module\n"
        f"sys.path[:0] = {[str(folder) for folder in Path(__file__).parents[:2]]}\n"
        "from test_cli import load_stub, Checkpoint, Event\n"
        "def fit_steps(*_, **__):\n"
        "    yield Checkpoint(load_stub(), 5, 0.1)\n"
        "    yield Event('fit', 0.2, 5, 10)\n"
        "    time.sleep(60)\n"
        "import_module('gsedit.fitting.fit').fit_steps = fit_steps\n"
        "from gsedit_cli.main import main\n"
        f"sys.argv = ['gsedit', 'fit', {str(photos)!r}, '-o', {str(tmp_path / 's.ply')!r}]\n"
        "main()\n"
    )
    process = subprocess.Popen([sys.executable, "-c", code], stderr=subprocess.PIPE, text=True)
    assert process.stderr is not None
    assert "fit 5/10" in process.stderr.readline()
    process.send_signal(stop)
    told = process.communicate(timeout=30)[1]
    assert process.returncode == 130
    assert "(step 5)" in told
    assert len(load(tmp_path / "s.checkpoint.ply")) == 3


# ---- edit ----------------------------------------------------------------------------------------


def stub_edit(monkeypatch, *, end: BaseException | None = None):
    from gsedit.session.result import EditResult
    from gsedit.views.plan import ViewPlan

    given = {}

    def edit_steps(scene, prompt, *, dataset, editor, settings, strategy, features, generator):
        given.update(prompt=prompt, settings=settings, dataset=dataset)
        yield Event("update", 1.0, 1, 2, 0.5, 0.1)
        yield Checkpoint(scene, 1, 1.0)
        if end is not None:
            raise end
        yield Event("measure", 2.0, error=0.05, note="well done")
        yield EditResult(
            scene=scene,
            originals=dataset.views,
            targets=dataset.views,
            finals=dataset.views,
            settings=settings,
            strategy=strategy,
            plan=ViewPlan(((0,),), (1.0,)),
            matched=0.5,
            pairs=(("a", "b", 0.5),),
            strength=0.1,
            residual=float("inf"),
            ground_truth=None,
            timings={"total": 2.0},
        )

    monkeypatch.setattr(import_module("gsedit.edit"), "edit_steps", edit_steps)
    return given


def test_edit_leaves_the_scene_and_its_evidence(monkeypatch, scene, photos, tmp_path):
    given = stub_edit(monkeypatch)
    out = tmp_path / "out"
    result = gsedit("edit", scene, "make it snow", "--data", photos, "-o", out, "--rounds", 1)
    assert result.exit_code == 0, result.stderr
    assert result.stdout.strip() == str(out / "scene.ply")
    names = {"scene.ply", "edit.json", "metrics.jsonl", "before_after.png", "error_vs_time.png"}
    assert {path.name for path in files(out)} == names
    assert [event.stage for event in read_events(out / "metrics.jsonl")] == ["update", "measure"]
    record = json.loads((out / "edit.json").read_text())
    assert record["instruction"] == given["prompt"] == "make it snow"
    assert record["settings"]["rounds"] == 1
    assert record["settings"]["sampler"]["steps"] == SamplerSettings().steps
    assert record["measured"]["residual"] is None  # JSON has no infinity
    assert set(record) >= {"seed", "versions", "threads", "timings", "platform", "python"}
    assert gsedit("edit", scene, "make it snow", "-o", out).exit_code == 2


def test_an_interrupted_edit_keeps_its_metrics_and_checkpoint(monkeypatch, scene, tmp_path):
    stub_edit(monkeypatch, end=KeyboardInterrupt())
    out = tmp_path / "out"
    result = gsedit("edit", scene, "make it snow", "-o", out, "--size", 16)
    assert result.exit_code == 130
    assert f"{out / 'checkpoint.ply'} (step 1)" in result.stderr
    assert {path.name for path in files(out)} == {"checkpoint.ply", "metrics.jsonl"}
    assert len(read_events(out / "metrics.jsonl")) == 1


def test_what_is_not_given_is_the_librarys_choice():
    nothing = (SamplerOptions(), UpdateOptions(), RoundOptions())
    assert resolve(Preset.default, *nothing)[0] == EditSettings()
    paper, _ = resolve(Preset.paper, *nothing)
    assert paper.sampler == SamplerSettings.preset("paper")
    some, strategy = resolve(
        Preset.paper,
        SamplerOptions(steps=7, consensus=False),
        UpdateOptions(update_steps=9),
        RoundOptions(views_per_round=2),
    )
    assert (some.sampler.steps, some.sampler.consensus, some.sampler.target) == (7, False, "xt")
    assert (strategy.update_steps, some.views_per_round) == (9, 2)
    assert resolve(Preset.default, *nothing, compile=True)[0].execution.compile


def test_a_fit_can_be_compiled(monkeypatch, photos, tmp_path):
    given = stub_fit(monkeypatch)
    result = gsedit("fit", photos, "-o", tmp_path / "scene.ply", "--minutes", 2, "--compile")
    assert result.exit_code == 0, result.stderr
    assert given["settings"].execution.compile


def test_the_defaults_in_the_help_are_the_librarys():
    text = " ".join(re.sub(r"[│\s]+", " ", gsedit("edit", "--help").stdout).split())
    sampler, update, edit = SamplerSettings(), UpdateSettings(), EditSettings()
    pix2pix = SamplerDefaults()
    for value in (
        f"Sampling steps (default {sampler.steps})",
        f"what suits the editor; {pix2pix.guidance_text}, small {DEFAULTS.guidance_text:g})",
        f"(likewise; {pix2pix.guidance_image}, small {DEFAULTS.guidance_image:g})",
        f"(likewise; {pix2pix.temperature:g}, small {DEFAULTS.temperature:g})",
        f"(default {SinglePass().update_steps})",
        f"(default {update.patches})",
        f"(default {update.patch})",
        f"(default {update.gram_weight})",
        f"(default {edit.views_per_round})",
        f"(default {edit.rounds})",
        f"(default {edit.coverage})",
        f"(default {edit.geometry})",
        f"(default {edit.condition})",
    ):
        assert value in text


# ---- narration -----------------------------------------------------------------------------------


def test_the_time_left_is_from_the_pace_so_far():
    line = plain_line(Event("fit", 30.0, 20, 40, 0.5), Event("fit", 10.0, 10, 40))
    assert "20/40" in line
    assert "about 40 s left" in line  # 2 seconds a step, 20 steps


def test_a_log_is_a_line_a_stage_and_now_and_then(capsys):
    with progress(as_json=False) as show:
        for second in range(100):
            show(Event("fit", float(second), second + 1, 100))
        show(Event("measure", 100.0, error=0.1))
    lines = capsys.readouterr().err.splitlines()
    assert lines[0].startswith("[0 s] fit 1/100")
    assert lines[-1] == "[100 s] measure 20.00 dB"
    assert len(lines) == 1 + 9 + 1 + 1  # first, every 10 seconds, last, and the other stage


def test_core_commands_do_without_the_viewers(scene, tmp_path):
    code = (
        "import sys; sys.modules.update(open3d=None, pyvista=None, vtk=None)\n"
        "import gsedit, gsedit.fitting.fit, gsedit.edit\n"
        "from gsedit_cli.main import app\n"
        "for words in (['info', sys.argv[1]], ['render', sys.argv[1], '--count', '1', '--size',\n"
        "              '16', '-o', sys.argv[2]]):\n"
        "    try: app(words)\n"
        "    except SystemExit as end: assert not end.code\n"
    )
    words = [sys.executable, "-c", code, str(scene), str(tmp_path / "out")]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "out" / "orbit_000.png").exists()
