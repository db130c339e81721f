"""A command says once what renders, and refuses a kernel that there is not."""

from __future__ import annotations

import pytest
from command_line import gsedit, one_line
from gsedit_cli.core.kernel import FITS, RENDERS, UPDATES, say_kernel

from gsedit.errors import UsageError
from rasterizer import Execution, compiled
from rasterizer.blending import cpp_backend


@pytest.fixture
def no_compiler(monkeypatch):
    monkeypatch.setenv("CXX", "/nowhere/c++")
    compiled.make.cache_clear()
    yield
    compiled.make.cache_clear()


def drawn(scene, out, *words):
    return gsedit("render", scene, "--count", 1, "--size", 16, "-o", out, *words)


def test_without_a_compiler_torch_renders_and_the_next_move_is_named(no_compiler, scene, tmp_path):
    result = drawn(scene, tmp_path / "a", "--json")
    assert result.exit_code == 0
    (line,) = (line for line in result.stderr.splitlines() if "renders" in line)
    assert line.startswith("no C++ compiler was found")
    assert "renders with torch, slower; name a C++17 compiler in CXX" in line
    assert "renders" not in result.stdout


def test_a_kernel_that_there_is_not_is_refused(no_compiler, scene, tmp_path):
    result = drawn(scene, tmp_path / "a", "--kernel", "compiled")
    assert result.exit_code == 2
    assert one_line(result.stderr.partition("gsedit: ")[2])
    assert "name a C++17 compiler in CXX" in result.stderr
    assert not (tmp_path / "a").exists()


def test_the_kernel_is_named_once_and_torch_not_at_all(scene, tmp_path):
    if compiled.make(cpp_backend.SOURCE).failure:
        pytest.skip("no C++ compiler on this machine")
    assert drawn(scene, tmp_path / "a").stderr.count("renders with the compiled kernel (") == 1
    assert "renders" not in drawn(scene, tmp_path / "b", "--kernel", "torch").stderr


def test_the_option_of_before_is_told_what_became_of_it(scene, tmp_path):
    result = drawn(scene, tmp_path / "a", "--compile")
    assert result.exit_code == 2
    assert "--kernel torch does without it" in result.stderr


@pytest.fixture
def made(monkeypatch):
    """Outcome of each C++ file by its name, a failure or a note; none is compiled."""
    says = {}

    def make(source):
        failure, note = says.get(source.name, ("", ""))
        return compiled.Made(None, "g++", failure, note)

    monkeypatch.setattr(compiled, "make", make)
    monkeypatch.setattr(compiled, "takes_seconds", lambda source: source.name != "kernel.cpp")
    return says


@pytest.mark.parametrize(("parts", "count"), [(RENDERS, 1), (UPDATES, 2), (FITS, 3)])
def test_what_is_compiled_is_counted_with_its_time(parts, count, made, capsys):
    say_kernel(Execution(), parts)
    first, second = capsys.readouterr().err.splitlines()
    files = "1 C++ file for" if count == 1 else f"{count} C++ files for"
    assert first == f"compiling {files} this machine, once: about {3 * count} seconds"
    assert second == "renders with the compiled kernel (g++)"


def test_a_kernel_that_fails_alone_is_named(made, capsys):
    made["front.cpp"] = made["photometric.cpp"] = ("g++ is too old", "")
    say_kernel(Execution(), FITS)
    line = capsys.readouterr().err.splitlines()[-1]
    assert line.startswith("g++ is too old: torch does the projection and the loss, slower; ")
    assert "the compiled kernel (g++) does the rest" in line
    with pytest.raises(UsageError, match=r"--kernel compiled: g.. is too old"):
        say_kernel(Execution(kernel="compiled"), FITS)
    del made["front.cpp"]
    say_kernel(Execution(kernel="compiled"), FITS)  # the loss is no picture
    made["kernel.cpp"] = ("g++ is too old", "")
    say_kernel(Execution(), FITS)
    assert "renders with torch, slower" in capsys.readouterr().err.splitlines()[-1]


def test_a_kernel_that_cannot_be_kept_is_told_in_one_line(made, capsys):
    made.update({name: ("", "cannot be kept") for name in ("kernel.cpp", "front.cpp")})
    say_kernel(Execution())
    assert capsys.readouterr().err.splitlines()[1:-1] == ["cannot be kept"]
