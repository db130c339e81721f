"""Laws of the losses, and of the filter bank under the Gram term."""

import pytest
import torch

from gsedit.measures.features import BINOMIAL, OPPONENT, FilterBank
from gsedit.measures.losses import dssim, gram, gram_loss, l1, mse, ssim


def picture(*shape, seed=0, dtype=torch.float64):
    return torch.rand(*shape, dtype=dtype, generator=torch.Generator().manual_seed(seed))


# ---- pictures ------------------------------------------------------------------------------------


@pytest.mark.parametrize("loss", [mse, l1, dssim])
def test_a_loss_is_zero_at_its_target_and_only_there(loss):
    image = picture(16, 16, 3)
    # kornia adds 1e-12 to SSIM's denominator, which is a few per cent here
    assert abs(loss(image, image)) < 1e-10
    assert loss(image, picture(16, 16, 3, seed=1)) > 0.01
    assert loss(image, picture(16, 16, 3, seed=1)) == loss(picture(16, 16, 3, seed=1), image)


def test_a_constant_offset_has_known_losses():
    image = picture(16, 16, 3) * 0.5
    torch.testing.assert_close(mse(image + 0.1, image), torch.tensor(0.01).double())
    torch.testing.assert_close(l1(image + 0.1, image), torch.tensor(0.1).double())
    flat = torch.full((16, 16, 3), 0.4, dtype=torch.float64)
    # SSIM of constants a, b is (2ab + C1) / (a^2 + b^2 + C1), C1 = 0.01^2 (Wang et al. 2004)
    expected = (2 * 0.4 * 0.6 + 1e-4) / (0.4**2 + 0.6**2 + 1e-4)
    # kornia adds 1e-12 to the denominator, here 0.52 x 0.0009
    assert abs(ssim(flat, flat + 0.2) - expected) < 1e-8


# ---- Gram ----------------------------------------------------------------------------------------


def test_gram_is_the_mean_outer_product():
    features = picture(2, 5, 7, 3)
    expected = torch.zeros(2, 5, 5, dtype=torch.float64)
    for n in range(2):
        for y in range(7):
            for x in range(3):
                expected[n] += torch.outer(features[n, :, y, x], features[n, :, y, x]) / 21
    torch.testing.assert_close(gram(features), expected)
    torch.testing.assert_close(gram(features[0]), expected[0])


def test_gram_does_not_see_where_things_are():
    features = picture(1, 6, 8, 8)
    shuffled = features.flatten(2)[
        ..., torch.randperm(64, generator=torch.Generator().manual_seed(0))
    ]
    torch.testing.assert_close(gram(shuffled.unflatten(2, (8, 8))), gram(features))
    torch.testing.assert_close(gram(torch.cat((features, features), 3)), gram(features))


def test_gram_loss_is_johnsons_summed_over_layers():
    """Johnson et al. 2016: the squared Frobenius norm, of matrices divided by c h w."""
    one, other = ([picture(2, 3, 4, 4, seed=s), picture(2, 5, 2, 2, seed=s)] for s in (0, 1))
    theirs = ((gram(a) - gram(b)) / a.shape[1] for a, b in zip(one, other))
    expected = sum(layer.square().sum((1, 2)).mean() for layer in theirs)
    torch.testing.assert_close(gram_loss(one, other), expected)
    assert gram_loss(one, one) == 0


def test_every_loss_has_its_gradient():
    image, target = picture(8, 8, 3).requires_grad_(), picture(8, 8, 3, seed=1)
    for loss in (mse, l1, dssim):
        assert torch.autograd.gradcheck(lambda t, loss=loss: loss(t, target), image, fast_mode=True)


# ---- the filter bank -----------------------------------------------------------------------------


def test_a_flat_picture_has_color_and_no_edges():
    color = torch.tensor([0.2, 0.9, 0.4], dtype=torch.float64)
    expected = torch.tensor(OPPONENT, dtype=torch.float64) @ (color - 0.5)
    for layer in FilterBank()(color[None, :, None, None].expand(1, 3, 64, 64)):
        colors, edges = layer[0, [0, 3, 6]], layer[0, [1, 2, 4, 5, 7, 8, 9, 10, 11]]
        assert edges.abs().max() < 1e-12
        # BINOMIAL and the Gaussian sum to one
        torch.testing.assert_close(colors, expected[:, None, None].expand_as(colors))
    assert sum(BINOMIAL) == 1


def test_features_are_linear_in_the_picture_about_grey():
    bank, a, b = FilterBank(2), picture(1, 3, 32, 32), picture(1, 3, 32, 32, seed=1)
    for both, one, other in zip(bank(a + b - 0.5), bank(a), bank(b)):
        torch.testing.assert_close(both, one + other)


def test_transposing_a_picture_swaps_its_derivatives():
    bank, image = FilterBank(2), picture(1, 3, 32, 32)
    swap = [0, 2, 1, 3, 5, 4, 6, 8, 7, 11, 10, 9]
    for turned, plain in zip(bank(image.mT), bank(image)):
        torch.testing.assert_close(turned.mT, plain[:, swap])


def test_a_repeated_texture_moved_by_its_period_has_the_same_gram():
    x = torch.arange(64).double()
    wave = 0.5 + 0.3 * torch.sin(2 * torch.pi * x / 8)
    image = wave.expand(1, 3, 64, 64)
    moved = image.roll(8, 3)
    assert gram_loss(FilterBank()(image), FilterBank()(moved)) < 1e-20
    assert gram_loss(FilterBank()(image), FilterBank()(image.mT)) > 1e-3
