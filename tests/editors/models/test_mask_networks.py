"""A network as a mask provider, against transformers' own classes run directly on tiny weights."""

import pytest
import tiny_segmenters as tiny
import torch
from PIL import Image

from gsedit.paper.editors import make_masks

PHRASE = "the red chair"


def pictures():
    """Two pictures of different size, whose values survive eight bits."""
    g = torch.Generator().manual_seed(0)
    sizes = ((24, 40), (33, 20))
    return [torch.randint(0, 256, (*size, 3), generator=g) / 255 for size in sizes]


def images():
    return [Image.fromarray((255 * each).round().byte().numpy()) for each in pictures()]


@pytest.fixture(scope="module")
def clipseg(tmp_path_factory):
    place = tmp_path_factory.mktemp("clipseg")
    model = tiny.clipseg(place / "words")
    return model, tiny.saved(place / "model", model)


@torch.no_grad()
def test_clipseg_is_equal_to_transformers(clipseg):
    (network, processor), folder = clipseg
    provider = make_masks("clipseg", model=str(folder))
    provider.check(PHRASE)
    found = list(provider.masks(pictures(), PHRASE))
    for mask, image in zip(found, images(), strict=True):
        inputs = processor(text=[PHRASE], images=[image], return_tensors="pt")
        logits = network(**inputs).logits.reshape(1, 1, 32, 32)
        size = (image.height, image.width)
        expected = torch.nn.functional.interpolate(logits, size, mode="bilinear")[0, 0].sigmoid()
        torch.testing.assert_close(mask, expected)
        assert expected.std() > 1e-4
