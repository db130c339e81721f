"""Cheaper checks of shapes and kept bytecode, set before anything is imported; a quick search for
views."""

import os
import sys

import jaxtyping
import pytest
from shape_checks import CALLS, checked

os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # every process of a test would compile the tree
sys.dont_write_bytecode = False
pytest.MonkeyPatch().setattr(jaxtyping, "jaxtyped", checked)


def pytest_runtest_call():
    """Calls are counted anew in each test."""
    CALLS.clear()


@pytest.fixture
def quick_search(monkeypatch):
    """Views of scenes without cameras have 64 pixels at most, and few places are tried."""
    from gsedit.views import around
    from gsedit.views.around import find_views
    from gsedit.views.search import SearchEffort

    few = SearchEffort(places=12, kept=4, rendered=8, varied=4)

    def find(scene, count, size, **options):
        return find_views(scene, count, min(size, 64), effort=few, **options)

    monkeypatch.setattr(around, "find_views", find)
