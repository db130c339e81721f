"""Masks of several views lifted to Gaussians: exact, noisy, of several things, of nothing."""

import pytest
import torch
from bench.staged import stage
from regions_iou import iou
from torch.nn.functional import avg_pool2d, max_pool2d

from gsedit.errors import GseditError, UsageError
from gsedit.select.masked import find_masked, lift_masks
from gsedit.select.region import find_drawn, lift

SIZE = 64


@pytest.fixture(scope="module")
def table():
    return stage("table")


@pytest.fixture(scope="module")
def labelled(table):
    return table.gaussians(4000)


@pytest.fixture(scope="module")
def maps(table):
    return [table.label_map(camera) for camera in table.training(SIZE)]


def exact(table, maps, *names):
    every = [each.name for each in table.everything]
    wanted = torch.tensor([every.index(name) for name in names])
    return [torch.isin(each, wanted).float() for each in maps]


def missed(masks, others):
    return [0 * mask if i % 3 == 0 else mask for i, mask in enumerate(masks)]


def mistaken(masks, others):
    return [other if i % 4 == 0 else mask for i, (mask, other) in enumerate(zip(masks, others))]


def wide(masks, others):
    return [max_pool2d(mask[None], 5, 1, 2)[0] for mask in masks]


def faint(masks, others):
    return [0.5 * avg_pool2d(mask[None], 9, 1, 4)[0] for mask in masks]


@pytest.mark.parametrize("noise", [lambda masks, others: masks, missed, mistaken, wide, faint])
def test_noisy_masks_find_the_thing_better_than_a_fixed_threshold(table, labelled, maps, noise):
    """Also where masks miss it in a third of the views, or show another thing in a quarter."""
    names = ("large red ball", "white pillar")
    masks = noise(exact(table, maps, names[0]), exact(table, maps, names[1]))
    cameras, true = table.training(SIZE), labelled.of(names[0])
    lifted = lift(labelled.scene, cameras, masks)
    seen = lifted.weight > 1e-3
    found = lift_masks(labelled.scene, cameras, masks)
    assert iou(found[seen], true[seen]) > 0.9
    fixed = find_drawn(labelled.scene, lifted)
    assert iou(found[seen], true[seen]) > iou(fixed[seen], true[seen]) - 0.03


def test_several_things_of_a_phrase_are_all_found(table, labelled, maps):
    names = ("large red ball", "blue ball", "white pillar")
    cameras = table.training(SIZE)
    found = lift_masks(labelled.scene, cameras, exact(table, maps, *names))
    for name in names:
        own = labelled.of(name) & labelled.scene.means.isfinite().all(1)
        assert (found & own).sum() > 0.8 * own.sum()


@pytest.mark.parametrize("value", [0.0, 1.0])
def test_all_or_nothing(table, labelled, value):
    cameras = table.training(SIZE)[:4]
    masks = [torch.full((SIZE, SIZE), value) for _ in cameras]
    found = lift_masks(labelled.scene, cameras, masks)
    assert float(found.float().mean()) == pytest.approx(value, abs=0.02)


class Reds:
    """Finds what is red in a picture."""

    name = "reds"

    def check(self, phrase):
        if "red" not in phrase:
            raise UsageError("only red")

    def masks(self, pictures, phrase):
        self.pictures = pictures
        for picture in pictures:
            red, green, blue = picture.unbind(-1)
            yield ((red > 0.4) & (red > 2.2 * green) & (red > 2.2 * blue)).float()


def test_a_provider_is_asked_about_pictures_of_the_scene(table, labelled):
    provider, cameras = Reds(), table.training(SIZE)
    region = find_masked("the red ones", labelled.scene, provider, cameras)
    assert [tuple(each.shape) for each in provider.pictures] == [(SIZE, SIZE, 3)] * len(cameras)
    true = labelled.of("large red ball", "small red ball")
    assert iou(region.inside, true) > 0.7
    assert "'the red ones' by reds, in 14 of 14 views" in str(region)
    with pytest.raises(UsageError, match="only red"):
        find_masked("the blue ones", labelled.scene, provider, cameras)


class Answers(Reds):
    def __init__(self, mask):
        self.mask = mask

    def masks(self, pictures, phrase):
        return (self.mask for _ in pictures)


def test_nothing_found_and_wrong_answers_are_told(table, labelled):
    cameras = table.training(SIZE)[:2]
    with pytest.raises(UsageError, match=r"find no 'red' in 2 views \(the surest pixel has 0.20"):
        find_masked("red", labelled.scene, Answers(torch.full((SIZE, SIZE), 0.2)), cameras)
    for mask in (torch.ones(3, 3), torch.full((SIZE, SIZE), torch.nan)):
        with pytest.raises(GseditError, match="ask their authors"):
            find_masked("red", labelled.scene, Answers(mask), cameras)
