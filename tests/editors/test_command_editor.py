"""A program as an editor: what it is given, and how it may fail."""

import stat
import sys

import pytest
import torch
from programs import INVERT, batch, leftovers, run

from gsedit.errors import GseditError, InputError, UsageError
from gsedit.paper.editors import make_editor
from gsedit.paper.editors.command import Command

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
    path = str(tmp_path / "argument")
    write = f"pathlib.Path({path!r}).write_text(sys.argv[3], encoding='utf-8', newline='')"
    editor = program(f"import pathlib, sys\n{write}\nassert len(sys.argv) == 4\n{INVERT}")
    run(editor, batch(prompt=prompt))
    assert (tmp_path / "argument").read_bytes().decode() == prompt
    assert not (tmp_path / "owned").exists()


# ---- how it may fail: every error says what remains, and nothing is lost -------------------------


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
    Command(f"{sys.executable} {{input}} {{output}}").check("")  # it is not given the instruction
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
    message = str(caught.value)
    assert "ended with code 3" in message
    assert "it said: line 4 | line 5 | line 6 | line 7 | line 8." in message
    assert "on stdout" not in message
    assert f"1 of 2 pictures are in {tmp_path / 'exchange'}" in message
    assert [p.parent.name for p in leftovers(tmp_path)] == ["input", "input", "output"]


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
