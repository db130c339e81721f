"""Shadows, highlights and sharpness: what is to change does, the rest keeps its bits."""

from __future__ import annotations

import pytest
import torch
from changes import painted

from gsedit.bench.synthetic import demo_scene, surface_gaussians
from gsedit.editing.painters import LOCAL
from gsedit.errors import UsageError
from gsedit.words.instruction import Change
from rasterizer.numerics import sh_to_color


def toned(scene, name, amount, inside):
    change = Change("subject", "tone", name, None, amount, "tone")
    return painted(scene, change, inside).scene


@pytest.fixture(scope="module")
def scene():
    return surface_gaussians(demo_scene(), 2000, torch.Generator().manual_seed(0))


@pytest.mark.parametrize("name", LOCAL)
@pytest.mark.parametrize("amount", [0.3, -0.3])
def test_only_the_part_changes_and_by_the_sign(scene, name, amount):
    inside = torch.arange(len(scene)) % 2 == 0
    after = toned(scene, name, amount, inside)
    assert torch.equal(after.sh[~inside], scene.sh[~inside])
    before, now = (sh_to_color(each.sh[inside, 0]) for each in (scene, after))
    if name == "sharpness":
        assert (now.std() > before.std()) == (amount > 0)
    else:
        assert (now.mean() > before.mean()) == (amount > 0)


def test_shadows_move_the_dark_most_and_highlights_the_light(scene):
    inside = torch.ones(len(scene), dtype=torch.bool)
    base = sh_to_color(scene.sh[:, 0]).mean(1)
    for name, rises in (("shadows", False), ("highlights", True)):
        gain = sh_to_color(toned(scene, name, 0.5, inside).sh[:, 0]).mean(1) / base
        order = torch.argsort(base)
        dark, light = gain[order[: len(order) // 4]].mean(), gain[order[-len(order) // 4 :]].mean()
        assert (light > dark) == rises


def test_a_share_out_of_range_is_refused(scene):
    with pytest.raises(UsageError, match="out of range"):
        toned(scene, "shadows", -2.0, torch.ones(len(scene), dtype=torch.bool))
