"""A program as an editor: what it is given, how it may fail, and how its pictures come to agree."""

from __future__ import annotations

import os
import shlex
import signal
import stat
import subprocess
import sys
import time
from pathlib import Path

import pytest
import torch
from PIL import Image

from gsedit.consistency.correspond import Correspondences, correspond
from gsedit.consistency.harmonise import cell_means, harmonise, robust_mean
from gsedit.diffusion import SamplerSettings
from gsedit.editors import EditBatch, make_editor
from gsedit.editors.command.editor import CELL, Command
from gsedit.errors import GseditError, InputError, UsageError
from gsedit.synthetic import demo_scene, ring_cameras, scenes

APART = SamplerSettings(consensus=False)
INVERT = """
import sys
from pathlib import Path
from PIL import Image, ImageOps
source, target = map(Path, sys.argv[1:3])
for path in sorted(source.iterdir()):
    ImageOps.invert(Image.open(path)).save(target / path.name)
"""


@pytest.fixture
def program(tmp_path):
    """Makes a command that runs some Python, with words after it."""

    def make(code: str, words: str = "{input} {output} {prompt}", **options) -> Command:
        path = tmp_path / "a program.py"  # a space in the name: quoting must hold
        path.write_text(code)
        run = f"{shlex.quote(sys.executable)} {shlex.quote(str(path))} {words}"
        return Command(run, folder=tmp_path / "exchange", **options)

    return make


def batch(views: int = 2, prompt: str = "make it snow", **more) -> EditBatch:
    g = torch.Generator().manual_seed(0)
    levels = torch.randint(256, (2, views, 6, 8, 3), generator=g)  # 8 bits: PNGs lose nothing
    return EditBatch(levels[0] / 255, levels[1] / 255, prompt, **more)


def run(editor: Command, request: EditBatch | None = None, settings=APART) -> torch.Tensor:
    *_, last = editor.edit(request or batch(), settings, torch.Generator())
    assert last.images is not None
    return last.images


def leftovers(tmp_path: Path) -> list[Path]:
    return sorted(p for p in (tmp_path / "exchange").rglob("*.png"))


# ---- what it is given ----------------------------------------------------------------------------


def test_it_is_given_the_originals_and_its_pictures_are_taken(program, tmp_path):
    request = batch()
    # 1e-6: an 8-bit level is read back to float32's rounding
    torch.testing.assert_close(
        run(program(INVERT), request), 1 - request.originals, rtol=0, atol=1e-6
    )
    assert not (tmp_path / "exchange").exists()  # nothing is left behind


def test_finished_views_are_neither_given_nor_changed(program):
    request = batch(3, anchored=torch.tensor([True, False, True]))
    edited = run(program(INVERT), request)
    assert torch.equal(edited[[0, 2]], request.images[[0, 2]])
    torch.testing.assert_close(edited[1], 1 - request.originals[1], rtol=0, atol=1e-6)
    done = batch(2, anchored=torch.tensor([True, True]))
    assert torch.equal(run(program("raise SystemExit(1)"), done), done.images)  # not even run


@pytest.mark.parametrize(
    "prompt",
    [
        "make it snow",
        "turn it into 'bronze' and \"gold\"",
        "$(touch owned) `touch owned`",
        "first line\nsecond line",
        "; touch owned; # && | > owned",
        "{input} {output} {seed}",
        r"back\slash \n *.png ~ $HOME",
        "snöwy ❄",
    ],
)
def test_the_instruction_is_one_argument_whatever_is_in_it(program, tmp_path, prompt, monkeypatch):
    monkeypatch.chdir(tmp_path)
    told = f"import pathlib, sys\npathlib.Path({str(tmp_path / 'told')!r}).write_text(sys.argv[3], "
    editor = program(f"{told}encoding='utf-8', newline='')\nassert len(sys.argv) == 4\n{INVERT}")
    run(editor, batch(prompt=prompt))
    assert (tmp_path / "told").read_bytes().decode() == prompt
    assert not (tmp_path / "owned").exists()


def test_fields_may_stand_inside_words_and_other_braces_stay(program, tmp_path):
    code = f"import sys\nopen({str(tmp_path / 'told')!r}, 'w').write(repr(sys.argv[3:]))\n{INVERT}"
    words = "{input} {output} --text={prompt} --seed={seed} '{\"json\": 1}'"
    run(program(code, words), batch(seed=7))
    assert (tmp_path / "told").read_text() == repr(
        ["--text=make it snow", "--seed=7", '{"json": 1}']
    )


def test_a_step_is_a_picture(program):
    request = batch(3)
    slowly = INVERT.replace("    Image", "    import time; time.sleep(0.3)\n    Image")
    slowly = slowly.replace("    ImageOps", "    import time; time.sleep(0.3)\n    ImageOps")
    items = list(program(slowly).edit(request, APART, torch.Generator()))
    steps = [item.step for item in items]
    assert steps == sorted(set(steps))
    assert steps[-1] == items[-1].steps == 4
    assert len(steps) > 1
    assert all(item.images is None for item in items[:-1])


# ---- how it may fail: every error says what remains, and nothing is lost -------------------------


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("my_editor {output}", r"--run has no \{input\}.*my_editor \{input\} \{output\}"),
        ("my_editor {input}", r"--run has no \{output\}"),
        ("my_editor {input} {output} {promt}", r"knows no \{promt\}, only \{input\}, .*\{prompt\}"),
        ("my_editor '{input} {output}", "cannot be split.*No closing quotation"),
    ],
)
def test_a_command_that_makes_no_sense(words, message):
    with pytest.raises(UsageError, match=message):
        Command(words)


def test_what_cannot_be_run_is_said_before_the_work(tmp_path):
    missing = Command("surely_no_such_program {input} {output}")
    with pytest.raises(UsageError, match=r"no program 'surely_no_such_program'.*install it"):
        missing.check("make it snow")
    with pytest.raises(UsageError, match="timeout must be more than 0"):
        Command("true {input} {output}", timeout=0.0)
    with pytest.raises(UsageError, match="add --run"):
        make_editor("command")
    fine = Command(f"{sys.executable} {{input}} {{output}} {{prompt}}")
    with pytest.raises(UsageError, match="NUL"):
        fine.check("snow\0")
    with pytest.raises(UsageError, match="empty"):
        fine.check(" ")
    Command(f"{sys.executable} {{input}} {{output}}").check("")  # it is not told the instruction
    script = tmp_path / "broken"
    script.write_text("#!/surely/no/such/interpreter\n")
    script.chmod(script.stat().st_mode | stat.S_IXUSR)
    with pytest.raises(UsageError, match="cannot be started"):
        run(Command(f"{script} {{input}} {{output}}"))


def test_a_failure_quotes_the_last_lines_and_keeps_what_was_made(program, tmp_path):
    code = INVERT + (
        "    print('on stdout')\n"
        "    [print('line', i, file=sys.stderr) for i in range(9)]\n"
        "    sys.exit(3)\n"
    )
    with pytest.raises(GseditError) as caught:
        run(program(code))
    told = str(caught.value)
    assert "ended with code 3" in told
    assert "it said: line 4 | line 5 | line 6 | line 7 | line 8." in told
    assert "on stdout" not in told
    assert f"1 of 2 pictures are in {tmp_path / 'exchange'}" in told
    assert [p.parent.name for p in leftovers(tmp_path)] == ["input", "input", "output"]


def test_failures_without_a_word_on_stderr(program):
    with pytest.raises(GseditError, match=r"ended with code 1; it said: only here\."):
        run(program("print('only here'); raise SystemExit(1)"))
    with pytest.raises(GseditError, match="it said nothing"):
        run(program("raise SystemExit(1)"))
    with pytest.raises(GseditError, match="was ended by SIGSEGV"):
        run(program(f"import os; os.kill(os.getpid(), {int(signal.SIGSEGV)})"))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("    if path.name != '001.png': pass", None),
        ("    if path.name == '001.png': (target / path.name).unlink()", r"made no 001\.png.*0 "),
        (
            "    (target / path.name).rename(target / ('new_' + path.name))",
            r"made no 000\.png \(it wrote new_000\.png, new_001\.png\).*same name",
        ),
        (
            "    Image.new('RGB', (4, 3)).save(target / path.name)",
            r"made 000\.png 4x3 pixels of one of 8x6.*camera",
        ),
        ("    (target / path.name).write_text('no picture')", r"000\.png is no readable picture"),
    ],
    ids=["none", "missing", "renamed", "resized", "broken"],
)
def test_pictures_that_are_missing_or_wrong(program, tmp_path, change, message):
    editor = program(INVERT + change)
    if message is None:
        run(editor)
        return
    with pytest.raises(InputError, match=message.replace("0 ", "")) as caught:
        run(editor)
    assert "pictures are in" in str(caught.value)
    assert len(leftovers(tmp_path)) >= 3


def test_grey_and_transparent_pictures_are_taken(program):
    code = INVERT.replace("ImageOps.invert(Image.open(path))", "Image.new('LA', (8, 6), (51, 255))")
    torch.testing.assert_close(run(program(code)), torch.full((2, 6, 8, 3), 0.2))


CHILD = """
import subprocess, sys, time
child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
open({pids!r}, "w").write(f"{{child.pid}} ")
import os
open({pids!r}, "a").write(f"{{os.getpid()}}\\n")
time.sleep(60)
"""


def ended(pids: list[int]) -> bool:
    """Whether none of these processes runs any more (a zombie has ended)."""
    for _ in range(100):
        running = [pid for pid in pids if runs(pid)]
        if not running:
            return True
        time.sleep(0.05)
    return False


def runs(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0]
    except OSError:
        return False
    return state != "Z"


needs_proc = pytest.mark.skipif(not Path("/proc/self").exists(), reason="looks at processes")


@needs_proc
def test_a_program_that_takes_too_long_is_ended_with_its_children(program, tmp_path):
    pids = tmp_path / "pids"
    editor = program(CHILD.format(pids=str(pids)), timeout=1.0)
    with pytest.raises(GseditError, match=r"stopped after 1 s: raise --timeout.*0 of 2 pictures"):
        run(editor)
    assert ended([int(pid) for pid in pids.read_text().split()])


@needs_proc
@pytest.mark.parametrize("how", ["close", "interrupt"])
def test_leaving_early_ends_the_program_and_its_children(program, tmp_path, how, monkeypatch):
    pids = tmp_path / "pids"
    first = INVERT + "    break\n"
    steps = program(first + CHILD.format(pids=str(pids))).edit(batch(), APART, torch.Generator())
    assert next(steps).step == 1
    while not pids.exists() or not pids.read_text().endswith("\n"):
        time.sleep(0.05)
    if how == "close":
        steps.close()
    else:
        monkeypatch.setattr("gsedit.editors.command.editor.wait", lambda _: raise_interrupt())
        with pytest.raises(KeyboardInterrupt):
            next(steps)
    assert ended([int(pid) for pid in pids.read_text().split()])
    assert [p.parent.name for p in leftovers(tmp_path)] == ["input", "input", "output"]


def raise_interrupt():
    raise KeyboardInterrupt


# ---- agreement after the fact --------------------------------------------------------------------


def test_few_values_have_their_mean_and_many_outvote_one():
    groups = torch.tensor([0, 1, 1, 2, 2, 2, 2, 2])
    values = torch.tensor([0.3, 0.2, 0.8, 0.5, 0.51, 0.49, 0.5, 1.0])[:, None].expand(-1, 3)
    found = robust_mean(values, groups, 3, torch.ones(8))
    torch.testing.assert_close(found[:2, 0], torch.tensor([0.3, 0.5]))
    assert abs(float(found[2, 0]) - 0.5) < 0.03  # the mean is 0.6
    wide = robust_mean(values, groups, 3, torch.ones(8), tolerance=1e3)
    torch.testing.assert_close(wide[2, 0], torch.tensor(0.6))
    outvoted = torch.tensor([1.0, 1, 0, 1, 1, 1, 1, 0])
    without = robust_mean(values, groups, 3, outvoted)
    torch.testing.assert_close(without[:, 0], torch.tensor([0.3, 0.2, 0.5]), atol=1e-6, rtol=0)


def flat_views(*colours: float, side: int = 8) -> torch.Tensor:
    return torch.tensor(colours)[:, None, None, None].expand(-1, side, side, 3).contiguous()


def everywhere(views: int, side: int = 8, cell: int = 2) -> Correspondences:
    """Cell i of every view shows the same."""
    count = side // cell
    labels = torch.arange(count**2).reshape(1, count, count).expand(views, -1, -1).contiguous()
    return Correspondences(labels, torch.ones(views, views), cell)


def test_agreement_laws():
    found = everywhere(3)
    images = flat_views(0.2, 0.3, 0.4)
    torch.testing.assert_close(harmonise(images, found), flat_views(0.3, 0.3, 0.3))
    torch.testing.assert_close(harmonise(images, found, strength=0.5), flat_views(0.25, 0.3, 0.35))
    assert torch.equal(harmonise(images, found, strength=0.0), images)
    led = harmonise(images, found, anchored=torch.tensor([True, False, False]))
    torch.testing.assert_close(led, flat_views(0.2, 0.2, 0.2))
    assert torch.equal(led[0], images[0])
    alone = Correspondences(torch.full((3, 4, 4), -1), torch.eye(3), 2)
    assert torch.equal(harmonise(images, alone), images)
    noise = torch.rand(3, 8, 8, 3, generator=torch.Generator().manual_seed(0))
    order = torch.tensor([2, 0, 1])
    # 1e-6: sums over views in another order
    torch.testing.assert_close(
        harmonise(noise[order], found), harmonise(noise, found)[order], rtol=0, atol=1e-6
    )
    with pytest.raises(UsageError, match="match the cells"):
        harmonise(noise[:2], found)
    with pytest.raises(UsageError, match="strength"):
        harmonise(noise, found, strength=2.0)


def test_detail_that_agrees_on_average_is_left_alone():
    """A pattern finer than a cell, shifted in one view: the means agree, and nothing is blurred."""
    stripes = torch.arange(8).remainder(2).float()[None, :, None].expand(8, -1, 3)
    images = torch.stack((stripes, 1 - stripes))
    torch.testing.assert_close(harmonise(images, everywhere(2)), images)


def test_sides_that_are_no_whole_cells():
    labels = torch.arange(12).reshape(1, 4, 3).expand(2, -1, -1).contiguous()
    found = Correspondences(labels, torch.ones(2, 2), 2)
    images = torch.stack((torch.full((7, 5, 3), 0.2), torch.full((7, 5, 3), 0.6)))
    torch.testing.assert_close(harmonise(images, found), torch.full((2, 7, 5, 3), 0.4))
    assert cell_means(images, 2).shape == (2, 4, 3, 3)


@pytest.fixture(scope="module")
def painted():
    """(originals, their true edit, correspondences, where views correspond): depth is exact."""
    (scene,) = (each for each in scenes() if each.name == "globe")  # the quickest to trace
    cameras = ring_cameras(scene, 20, 128)[:5]
    traced = [scene.trace(camera, 2) for camera in cameras]
    originals = torch.stack([t.image for t in traced]).float()
    found = correspond(
        cameras,
        torch.stack([t.depth for t in traced]),
        torch.stack([t.hit.double() for t in traced]),
        cell=CELL,
    )
    where = (found.labels >= 0).repeat_interleave(CELL, 1).repeat_interleave(CELL, 2)
    return originals, 1 - originals.flip(-1), found, where


def disagreement(images: torch.Tensor, found: Correspondences) -> float:
    """RMSE of cells about the plain mean of their cluster."""
    rows = found.labels.reshape(-1) >= 0
    values = cell_means(images, found.cell).reshape(-1, 3)[rows]
    groups = found.labels.reshape(-1)[rows].long()
    centre = robust_mean(values, groups, found.count, torch.ones(len(values)), 1e3)
    return float((values - centre[groups]).square().mean().sqrt())


def test_tints_of_views_are_evened_out_and_the_edit_is_kept(painted):
    originals, truth, found, where = painted
    g = torch.Generator().manual_seed(0)
    gains = 1 + 0.1 * torch.randn(5, 1, 1, 3, generator=g)
    edited = (truth * gains).clamp(0, 1)
    harmonised = harmonise(edited, found)
    # what stays is detail in which the nearest cells of true edits differ too
    assert disagreement(harmonised, found) < 0.3 * disagreement(edited, found)
    assert disagreement(harmonised, found) < 1.5 * disagreement(truth, found)
    error, before = (float((x - truth)[where].square().mean().sqrt()) for x in (harmonised, edited))
    assert error < 0.71 * before  # a cluster of two keeps 1 / sqrt(2) of their tints, larger less
    kept = (harmonised - originals)[where].mean() / (edited - originals)[where].mean()
    assert 0.97 < float(kept) < 1.03
    outside = torch.nn.functional.max_pool2d(where[:, None].double(), 21, 1, 10)[:, 0] == 0
    assert torch.equal(harmonised[outside], edited[outside])


def test_a_view_with_another_edit_is_outvoted(painted):
    originals, truth, found, where = painted
    edited = truth.clone()
    edited[2] = originals[2]  # this view was not edited at all
    harmonised, plain = harmonise(edited, found), harmonise(edited, found, tolerance=1e3)

    def error(images: torch.Tensor, view: slice | int) -> float:
        return float((images - truth)[view][where[view]].square().mean().sqrt())

    assert error(harmonised, 2) < 0.5 * error(edited, 2)
    others = [view for view in range(5) if view != 2]
    for view in others:  # the mean drags them; a vote of two against one cannot be won
        assert error(harmonised, view) < error(plain, view)
    assert error(harmonised, slice(None)) < 0.7 * error(plain, slice(None))


def test_the_true_edit_is_hardly_damaged(painted):
    _, truth, found, where = painted
    damage = float((harmonise(truth, found) - truth)[where].square().mean().sqrt())
    assert damage < 0.5 * disagreement(truth, found)  # averaging the cells would cost all of it


def test_a_program_s_pictures_are_settled(program):
    code = INVERT.replace(
        "ImageOps.invert(Image.open(path))", "Image.new('RGB', (8, 6), level(path))"
    )
    code = f"def level(path):\n    return (51 + 51 * int(path.stem),) * 3\n{code}"
    labels = torch.arange(12).reshape(1, 3, 4).expand(2, -1, -1).contiguous()
    request = batch(correspondences=Correspondences(labels, torch.ones(2, 2), 2))
    apart = torch.stack((torch.full((6, 8, 3), 0.2), torch.full((6, 8, 3), 0.4)))
    torch.testing.assert_close(run(program(code), request), apart)  # consensus is off
    together = run(program(code), request, SamplerSettings())
    torch.testing.assert_close(together, torch.full((2, 6, 8, 3), 0.3))
    half = run(program(code), request, SamplerSettings(consensus_strength=0.5))
    torch.testing.assert_close(half, apart * 0.5 + 0.15)


# ---- from the command line -----------------------------------------------------------------------


@pytest.fixture
def scene(tmp_path) -> Path:
    import gsedit
    from gsedit.synthetic import surface_gaussians

    path = tmp_path / "bear.ply"
    gsedit.save(surface_gaussians(demo_scene(), 1000, torch.Generator().manual_seed(0)), path)
    return path


def edit_words(scene: Path, out: Path, command: str) -> list[str]:
    return [
        "edit", str(scene), "fade $(it) \"now\"", "-o", str(out), "--editor", "command",
        "--run", command, "--size", "48", "--views", "2", "--rounds", "2", "--coverage", "1",
        "--update-steps", "4", "--patch", "16",
    ]  # fmt: skip


def test_an_edit_with_a_program_and_one_that_fails_in_the_second_round(program, scene, tmp_path):
    from gsedit_cli.main import app
    from typer.testing import CliRunner

    out = tmp_path / "out"
    good = CliRunner().invoke(app, edit_words(scene, out, program(INVERT).run))
    assert good.exit_code == 0, good.stderr
    assert (out / "before_after.png").exists()
    assert not (out / "command").exists()

    memory = tmp_path / "ran before"
    once = f"from pathlib import Path as P\nimport sys\nif P({str(memory)!r}).exists():\n"
    once += f"    sys.exit('no memory left')\nP({str(memory)!r}).touch()\n"
    bad = CliRunner().invoke(app, [*edit_words(scene, out, program(once + INVERT).run), "-f"])
    assert bad.exit_code == 1
    assert "ended with code 1; it said: no memory left." in bad.stderr
    assert "last complete checkpoint" in bad.stderr
    assert "Traceback" not in bad.stderr
    assert (out / "checkpoint.ply").exists()  # the first round's
    assert len(list((out / "command").rglob("input/*.png"))) == 2


@needs_proc
def test_ctrl_c_ends_the_program_and_says_what_remains(program, scene, tmp_path):
    pids = tmp_path / "pids"
    command = program(CHILD.format(pids=str(pids))).run
    words = edit_words(scene, tmp_path / "out", command)
    code = f"from gsedit_cli.main import main; import sys; sys.argv[1:] = {words!r}; main()"
    process = subprocess.Popen(
        [sys.executable, "-c", code], stderr=subprocess.PIPE, text=True, env=os.environ
    )
    for _ in range(600):
        if pids.exists() and pids.read_text().endswith("\n"):
            break
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    told = process.communicate(timeout=30)[1]
    assert process.returncode == 130
    assert "interrupted; no checkpoint was complete yet" in told
    assert ended([int(pid) for pid in pids.read_text().split()])


def test_pictures_are_written_as_they_are(program, tmp_path):
    """The program sees the 8-bit levels of the originals, at their own size."""
    request = batch(1)
    with pytest.raises(GseditError):
        run(program("raise SystemExit(1)"), request)
    (path,) = leftovers(tmp_path)
    with Image.open(path) as picture:
        assert picture.mode == "RGB"
        assert picture.size == (8, 6)
        levels = torch.tensor(list(picture.tobytes())).reshape(6, 8, 3)
    assert torch.equal(levels, (request.originals[0] * 255).round().long())
