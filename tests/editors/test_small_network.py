"""The network of the small editor: laws that hold for any weights."""

from __future__ import annotations

import pytest
import torch
from closeness import NETWORK, assert_near
from small_networks import TINY, random_network

from gsedit.paper.editors.small.editor import Small
from gsedit.paper.editors.small.network import CHANNELS, SmallNetwork


@pytest.fixture(scope="module")
def small() -> Small:
    return Small(random_network())


def noise(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed))


def predict(network, x, sigma, picture, shown=1.0, look=0):
    """x0 of the network."""
    n = len(x)
    text = network.looks(torch.tensor([look] * n))
    mask = torch.full((n,), shown)
    prepared = network.prepare(picture, mask, network.encode_image(picture, mask))
    return network.denoise(x, torch.full((n,), sigma), prepared, text)


def test_an_untrained_network_predicts_the_picture_where_all_is_noise():
    torch.manual_seed(0)
    x, picture = noise(2, CHANNELS, 8, 8), noise(2, CHANNELS, 8, 8, seed=1)
    x0 = predict(SmallNetwork(TINY), x, 1e6, picture)
    torch.testing.assert_close(x0, picture, atol=1e-4, rtol=1e-4)


def test_a_dropped_picture_has_no_influence(small):
    x = noise(1, CHANNELS, 8, 8)
    one, other = noise(1, CHANNELS, 8, 8, seed=1), noise(1, CHANNELS, 8, 8, seed=2)
    dropped = [predict(small.network, x, 1.0, picture, 0.0) for picture in (one, other)]
    assert torch.equal(*dropped)
    assert not torch.equal(*(predict(small.network, x, 1.0, picture) for picture in (one, other)))


def test_looks_of_one_pass_are_as_apart(small):
    """The network computes once for both what it computes for each."""
    network, x, picture = small.network, noise(2, CHANNELS, 5, 7), noise(2, CHANNELS, 5, 7, seed=1)
    ones = torch.ones(2)
    prepared = network.prepare(picture, ones, network.encode_image(picture, ones))
    text = network.looks(torch.tensor([1, 1, 0, 0]))
    together = network.denoise(x, 2 * ones, prepared, text).chunk(2)
    for each, look in zip(together, (1, 0)):
        apart = predict(network, x, 2.0, picture, look=look)
        assert_near(each, apart, NETWORK)
