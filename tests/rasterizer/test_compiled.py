"""The compiled kernel blends what torch blends, is made once, and stops only who asks for it."""

import gc
import os
import signal
import weakref

import pytest
import torch
from closeness import leaves
from scenes import cloud

from rasterizer import Execution, render, tiles
from rasterizer import compiled as library
from rasterizer.blending import cpp_backend as compiled
from rasterizer.cpp_projection import kernel as front

TORCH, COMPILED = Execution(kernel="torch"), Execution(kernel="compiled")
pytestmark = pytest.mark.filterwarnings("error")


@pytest.fixture
def kernel():
    if compiled.load() is None:
        pytest.skip("no C++ compiler on this machine")


@pytest.fixture
def empty_cache(tmp_path, monkeypatch):
    """A cache without a kernel; the one of before is back afterwards."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    library.make.cache_clear()
    yield tmp_path / "cache" / "gsedit"
    library.make.cache_clear()


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system does not fork")
@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
def test_a_forked_process_draws_too(kernel):
    """The threads of OpenMP stay with the parent."""
    scene, camera = cloud()
    before = torch.get_num_threads()
    try:
        torch.set_num_threads(2)
        wanted = render(scene, camera, execution=COMPILED).color
        child = os.fork()
        if not child:
            signal.alarm(20)  # ends it where it waits
            found = render(scene, camera, execution=COMPILED).color
            os._exit(not torch.equal(found, wanted))
        assert os.waitpid(child, 0)[1] == 0
    finally:
        torch.set_num_threads(before)


@pytest.mark.parametrize(
    ("execution", "module", "maker"),
    [(TORCH, tiles, "bin_tiles"), (COMPILED, front, "Bins")],
    ids=["torch", "compiled"],
)
def test_a_picture_is_freed_when_it_is_dropped(execution, module, maker, kernel, monkeypatch):
    scene, camera = cloud()
    lists = []
    make = getattr(module, maker)

    def spy(*args, **kwargs):
        bins = make(*args, **kwargs)
        lists.append(weakref.ref(bins))  # the backward pass holds it
        return bins

    monkeypatch.setattr(module, maker, spy)
    gc.disable()  # counting references must suffice: a cycle would keep every picture of a fit
    try:
        picture = render(leaves(scene), camera, execution=execution).color
        assert lists[0]() is not None
        del picture
        assert lists[0]() is None
    finally:
        gc.enable()


@pytest.mark.parametrize(
    ("named", "reason", "move"),
    [
        ("/nowhere/c++", "no C.. compiler", "or unset it"),
        ("", "no C.. compiler", "or unset it"),
        ("g++ 'x", "CXX is no command line", "or unset it"),
        ("false", "could not compile", "another"),
    ],
)
def test_without_a_compiler_torch_renders_where_none_is_asked_for(
    named, reason, move, empty_cache, monkeypatch
):
    monkeypatch.setenv("CXX", named)
    scene, camera = cloud()
    drawn = render(scene, camera)  # without a warning
    assert torch.equal(drawn.color, render(scene, camera, execution=TORCH).color)
    with pytest.raises(RuntimeError, match=f"{reason}.*CXX.*{move}|{reason}.*{move}.*CXX"):
        render(scene, camera, execution=COMPILED)
