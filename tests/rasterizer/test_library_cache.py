"""A compiled library is kept where only the user writes, made elsewhere if need be, and opened only
where nobody else can have put it."""

import os
import shutil
import stat
import sys
import time

import pytest

from rasterizer import compiled, compiler

pytestmark = pytest.mark.filterwarnings("error")
owners = pytest.mark.skipif(not hasattr(os, "geteuid"), reason="files have no owners here")


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """The folder of an empty cache; the one of before is back afterwards."""
    try:
        compiler.find_compiler()
    except compiler.CompilerError as error:
        pytest.skip(str(error))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    compiled.make.cache_clear()
    yield tmp_path / "cache" / "gsedit"
    compiled.make.cache_clear()


@pytest.fixture
def source(tmp_path):
    """A C++ file that compiles in no time."""
    return written(tmp_path, 42)


def written(folder, answer):
    path = folder / "answer.cpp"
    path.write_text(
        f'extern "C" void use_team(void*) {{}}\nextern "C" int answer() {{ return {answer}; }}\n'
    )
    return path


@pytest.fixture
def planted(source, cache, tmp_path):
    """A library in the cache, under the right name, that gives another answer."""
    found = compiler.find_compiler()
    name = compiled._name(found, source)
    folder = tmp_path / "other"
    folder.mkdir()
    compiler.compile_library(found, written(folder, 13), folder / "kernel.so")
    cache.mkdir(parents=True)
    path = cache / f"{name}-{compiled.digest((folder / 'kernel.so').read_bytes())}.so"
    shutil.copyfile(folder / "kernel.so", path)
    return path


def answer(source):
    compiled.make.cache_clear()
    return compiled.make(source).library.answer()


@pytest.mark.parametrize("share", [0.0, 0.5], ids=["start", "half"])
def test_what_does_not_load_is_made_anew_and_kept(share, source, cache, planted, monkeypatch):
    whole = planted.read_bytes()
    planted.write_bytes(whole[: int(share * len(whole))])  # opening half a one ends the process
    assert compiled.takes_seconds(source)
    assert answer(source) == 42
    assert compiled.make(source).note == ""
    (kept,) = cache.iterdir()
    assert len(kept.read_bytes()) == len(whole)
    monkeypatch.setattr(compiled, "compile_library", None)  # the next process does not compile it
    assert not compiled.takes_seconds(source)
    assert answer(source) == 42


@owners
def test_a_file_that_others_can_write_is_not_opened(source, planted):
    assert answer(source) == 13  # the user's own is trusted
    planted.chmod(0o666)
    assert answer(source) == 42


@owners
@pytest.mark.skipif(hasattr(os, "geteuid") and os.geteuid() != 0, reason="only root gives away")
def test_files_of_another_user_are_not_opened(source, cache, planted):
    os.chown(planted, 65534, 65534)
    assert answer(source) == 42
    assert compiled.make(source).note == ""
    os.chown(cache, 65534, 65534)
    assert answer(source) == 42
    assert "it belongs to another user" in compiled.make(source).note


@pytest.fixture
def public(tmp_path):
    """All folders above are open to others, who could not reach it through a closed one."""
    closed = [tmp_path, *(each for each in tmp_path.parents if each.stat().st_mode & 0o077 == 0)]
    for each in closed:
        each.chmod(0o755)
    yield
    for each in closed:
        each.chmod(0o700)


@owners
def test_a_folder_in_which_others_can_rename_is_not_used(source, cache, planted, public, tmp_path):
    cache.parent.chmod(0o777)
    assert answer(source) == 42
    note = compiled.make(source).note
    assert f"{cache.parent}: other users can write it" in note
    assert note.endswith("a folder that only you can write")
    cache.parent.chmod(0o1777)  # sticky: they can rename only what is theirs
    assert answer(source) == 13
    cache.parent.chmod(0o777)
    tmp_path.chmod(0o700)  # they cannot get there
    assert answer(source) == 13


@owners
def test_the_folder_is_closed_to_others(source, cache):
    cache.mkdir(parents=True)
    cache.chmod(0o777)
    assert answer(source) == 42
    assert stat.S_IMODE(cache.stat().st_mode) == 0o700
    assert len(list(cache.iterdir())) == 1


def test_cxx_may_have_words_and_reaches_no_shell(source, cache, tmp_path, monkeypatch):
    found = compiler.find_compiler().command[0]
    monkeypatch.setenv("CXX", f"{found} -O1")
    assert answer(source) == 42
    assert compiled.make(source).compiler.endswith(" -O1")
    assert len(list(cache.iterdir())) == 1
    monkeypatch.setenv("CXX", f"{found}; touch {tmp_path / 'touched'}")
    compiled.make.cache_clear()
    assert compiled.make(source).library is None
    assert not (tmp_path / "touched").exists()


@pytest.mark.skipif(sys.platform == "win32", reason="a shell script")
def test_a_compiler_that_hangs_is_given_up_with_its_children(source, cache, tmp_path, monkeypatch):
    script = tmp_path / "cxx"
    script.write_text("#!/bin/sh\nsleep 30\nexit 1\n")
    script.chmod(0o755)
    monkeypatch.setenv("CXX", str(script))
    began = time.monotonic()
    with pytest.raises(compiler.CompilerError, match=r"cxx did not end within 0\.2 s") as raised:
        compiler.compile_library(
            compiler.find_compiler(), source, tmp_path / "kernel.so", timeout_s=0.2
        )
    assert time.monotonic() - began < 10
    assert raised.value.move == compiler.OTHER_COMPILER
