"""Cheaper checks of shapes and kept bytecode, set before anything is imported; a quick search for
views, a ball."""

import os
import sys

import jaxtyping
import pytest
import torch
from shape_checks import CALLS, checked

os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # every process of a test would compile the tree
sys.dont_write_bytecode = False
pytest.MonkeyPatch().setattr(jaxtyping, "jaxtyped", checked)


def pytest_runtest_call():
    """Calls are counted anew in each test."""
    CALLS.clear()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol():
    """Threads that a command sets for good end with its test: in later ones they would wait busily
    for each other, of all workers."""
    threads = torch.get_num_threads()
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("OMP_NUM_THREADS", str(threads))
        result = yield
    torch.set_num_threads(threads)
    return result


@pytest.fixture(scope="session", autouse=True)
def looked_at_once():
    """The network that finds subjects looks at each picture once: half a second each."""
    from gsedit.select.subject import U2Net

    look = U2Net.forward

    def known(network, x):
        seen, key = network.__dict__.setdefault("seen", {}), x.numpy().tobytes()
        return seen.setdefault(key, seen.get(key) if key in seen else look(network, x))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(U2Net, "forward", known)
        yield


@pytest.fixture
def quick_search(monkeypatch):
    """Views of scenes without cameras have 64 pixels at most, and few places are tried."""
    from gsedit.views import around
    from gsedit.views.around import find_views
    from gsedit.views.search import SearchEffort

    few = SearchEffort(places=12, kept=4, rendered=8)

    def find(scene, count, size, **options):
        return find_views(scene, count, min(size, 64), effort=few, **options)

    monkeypatch.setattr(around, "find_views", find)


@pytest.fixture(scope="module")
def quick_saliency():
    """All that is not black stands out, where it does not matter what the subject is."""
    with pytest.MonkeyPatch.context() as patch:
        drawn = lambda x: (x.amax(1) > -1.7).float()  # noqa: E731 (of normalised colors)
        patch.setattr("gsedit.select.subject.load_network", lambda: drawn)
        yield


@pytest.fixture(scope="module")
def ball():
    """The truth of a stone ball in a garden, the scene, its own Gaussians, and cameras; what is
    found out of that scene is kept."""
    from bench.reflective import Finish, LitSolid, captured, garden, plain_base
    from small_scenes import globe

    from gsedit.bench.synthetic import ring_cameras
    from gsedit.scene.cache import SceneCache

    lit = LitSolid(globe(), garden)
    stone = Finish(plain_base((0.5, 0.45, 0.4)), specular=0.0)
    scene, own = captured(lit, stone, 800, 2000, torch.Generator().manual_seed(0))
    cameras = (*ring_cameras(lit.solid, 7, 64), *ring_cameras(lit.solid, 5, 64, elevation=55.0))
    with SceneCache(scene).used():
        yield lit, scene, own, cameras
