"""A wheel's libraries: the widest vectors that the processor has are opened, never wider ones."""

import pytest
import torch

from rasterizer import compiled
from rasterizer.compiler import CompilerError, find_compiler

SOURCE = 'extern "C" void use_team(void*) {{}}\nextern "C" int answer() {{ return {}; }}\n'


@pytest.fixture(autouse=True)
def _forget():
    compiled.make.cache_clear()
    yield
    compiled.make.cache_clear()


@pytest.fixture
def processor(monkeypatch):
    """Sets what torch says of an x86-64 processor."""

    def has(capability):
        monkeypatch.setattr(torch.backends.cpu, "get_cpu_capability", lambda: capability)
        monkeypatch.setattr(compiled.platform, "machine", lambda: "x86_64")

    return has


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """A folder with a C++ file and its libraries, each with the number of its level."""
    folder = tmp_path_factory.mktemp("wheel")
    try:
        compiler = find_compiler()
    except CompilerError as error:
        pytest.skip(str(error))
    plain = folder / "answer.cpp"
    for number, level in enumerate((compiled.PLAIN, compiled.WIDE, compiled.WIDEST)):
        plain.write_text(SOURCE.format(number))
        path = compiled.library_path(plain, level)
        # without the level's flags: the test of the choice may run on a processor that lacks them
        compiled.compile_library(compiler, plain, path, tunings=((),))
    return plain


@pytest.mark.parametrize(
    ("capability", "names"),
    [
        ("AVX512", ["avx512", "avx2", "plain"]),
        ("AVX2", ["avx2", "plain"]),
        ("DEFAULT", ["plain"]),
        ("of a later torch", ["plain"]),
    ],
)
def test_no_level_is_taken_that_the_processor_lacks(capability, names, processor):
    processor(capability)
    assert [level.name for level in compiled.usable_levels()] == names


@pytest.mark.parametrize(("capability", "answer"), [("AVX512", 2), ("AVX2", 1), ("DEFAULT", 0)])
def test_the_wheels_library_is_opened_without_a_compiler(
    capability, answer, processor, wheel, tmp_path, monkeypatch
):
    processor(capability)
    monkeypatch.setenv("CXX", "/nowhere/c++")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    made = compiled.make(wheel)
    assert made.library is not None
    assert made.library.answer() == answer
    assert made.compiler.startswith("of the wheel, ")
    assert not compiled.takes_seconds(wheel)
    assert not list(tmp_path.iterdir())


def test_one_that_does_not_load_is_passed_over(wheel, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    source = tmp_path / "answer.cpp"
    source.write_text(SOURCE.format(42))
    for level in compiled.levels():
        compiled.library_path(source, level).write_text("no library")
    made = compiled.make(source)
    assert made.library is not None
    assert made.library.answer() == 42


def test_every_level_is_compiled(tmp_path):
    source = tmp_path / "answer.cpp"
    source.write_text(SOURCE.format(42))
    made = compiled.compile_levels(find_compiler(), source, tmp_path / ".", ("-O0",))
    assert [path.name for path in made] == [f"answer-{each.name}.so" for each in compiled.levels()]
    assert compiled.make(source).library.answer() == 42
