"""Results about one scene that are kept: the same, sooner, and for that scene alone."""

from dataclasses import replace
from threading import Barrier, Thread
from typing import Any

import pytest
import torch

from gsedit.bench.synthetic import demo_scene, surface_gaussians
from gsedit.scene.cache import SceneCache, cached_per_scene
from rasterizer.scene import Gaussians


@pytest.fixture
def scene():
    return surface_gaussians(demo_scene(), 300, torch.Generator().manual_seed(0)).detach()


class Counted:
    """A function of a scene that tells how often it computed."""

    def __init__(self):
        self.times = 0

        @cached_per_scene
        def function(scene: Gaussians, factor: Any = 1.0) -> Any:
            self.times += 1
            return (scene.means.sum() * factor).sum()

        self.function = function


def test_the_same_question_of_the_same_scene_is_computed_once(scene):
    count, place = Counted(), SceneCache(scene)
    with place.used():
        first = count.function(scene, 1.0)
        assert count.function(scene.detach(), 1.0) is first  # another name of the same memory
        assert count.function(scene) is first  # the default
    assert count.times == 1
    count.function(scene, 2.0)
    assert count.times == 2  # nothing is kept where no place is in use


@pytest.mark.parametrize("field", ["means", "sh", "logit_opacities"])
def test_another_scene_or_one_that_was_written_to_is_computed_and_not_kept(scene, field):
    count = Counted()
    other = replace(scene, **{field: getattr(scene, field) + 1})
    with SceneCache(scene).used():
        for each in (scene, other, other):
            count.function(each)
        scene.means.add_(1.0)
        count.function(scene)
    assert count.times == 4


def test_arguments_are_told_apart_by_what_they_hold(scene):
    count, flags = Counted(), torch.zeros(3, dtype=torch.bool)
    with SceneCache(scene).used():
        count.function(scene, flags)
        count.function(scene, flags.clone())
        assert count.times == 1
        flags[1] = True
        count.function(scene, flags)
        assert count.times == 2


def test_two_threads_that_ask_at_once_compute_once(scene):
    count, place, start = Counted(), SceneCache(scene), Barrier(2)

    def ask():
        with place.used():
            start.wait()
            count.function(scene)

    threads = [Thread(target=ask) for _ in range(2)]
    for each in threads:
        each.start()
    for each in threads:
        each.join()
    assert count.times == 1
