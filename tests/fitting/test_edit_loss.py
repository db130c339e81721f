"""The loss of the update: its terms, their weights, the switch between them."""

from __future__ import annotations

import pytest
import torch

from gsedit.capture.fitting.settings import UpdateSettings
from gsedit.capture.fitting.update import check_installed
from gsedit.errors import UsageError
from gsedit.measures.features import FilterBank
from gsedit.measures.losses import LOSSES, LossTerm, dssim, edit_loss, gram_loss, l1, mse
from gsedit.measures.perceptual import is_installed, perceptual_distance

BANK = FilterBank(2)


def pictures(seed: int, side: int = 32) -> torch.Tensor:
    return torch.rand(2, side, side, 3, generator=torch.Generator().manual_seed(seed))


def loss_of(settings: UpdateSettings, image=None, target=None) -> torch.Tensor:
    image = pictures(0) if image is None else image
    target = pictures(1) if target is None else target
    return edit_loss(image, target, settings.terms, BANK)


def test_mse_and_gram_are_the_papers_sum_to_the_last_bit():
    image, target = pictures(0), pictures(1)
    layers, targets = (BANK(t.permute(0, 3, 1, 2)) for t in (image, target))
    expected = mse(image, target) + 30.0 * gram_loss(layers, targets)
    assert loss_of(UpdateSettings(loss="mse+gram")) == expected
    assert loss_of(UpdateSettings()) == mse(image, target)
    assert loss_of(UpdateSettings(), image, image) == 0
    single = edit_loss(image[0], target[0], UpdateSettings().terms, BANK)
    torch.testing.assert_close(
        single, edit_loss(image[:1], target[:1], UpdateSettings().terms, BANK)
    )


def test_terms_are_weighed_and_added():
    image, target = torch.full((1, 16, 16, 3), 0.5), torch.full((1, 16, 16, 3), 0.25)
    for text, expected in (
        ("mse", 0.0625),
        ("l1", 0.25),
        ("2*mse+l1", 0.375),
        ("0.8 * l1 + 0 * dssim", 0.2),
        # flat pictures: SSIM is (2 a b + C1) / (a^2 + b^2 + C1), C1 = 1e-4
        ("dssim", 1 - (2 * 0.5 * 0.25 + 1e-4) / (0.3125 + 1e-4)),
    ):
        found = float(loss_of(UpdateSettings(loss=text), image, target))
        assert found == pytest.approx(expected, abs=1e-5), text
    splatting, both = loss_of(UpdateSettings(loss="0.8*l1+0.2*dssim")), (pictures(0), pictures(1))
    torch.testing.assert_close(splatting, 0.8 * l1(*both) + 0.2 * dssim(*both))
    assert UpdateSettings(loss="6*gram").terms == (LossTerm("gram", 6.0),)


def test_a_loss_is_added_by_its_row(monkeypatch):
    monkeypatch.setitem(LOSSES, "largest", lambda image, target: (image - target).abs().amax())
    largest = (pictures(0) - pictures(1)).abs().amax()
    assert loss_of(UpdateSettings(loss="2*largest")) == 2 * largest


@pytest.mark.skipif(not is_installed(), reason="needs stlpips_pytorch")
def test_perceptual_is_the_learned_distance_and_has_a_gradient():
    distance = perceptual_distance()
    image, target = pictures(0, 48).requires_grad_(), pictures(1, 48)
    loss = loss_of(UpdateSettings(loss="l1+perceptual"), image, target)
    torch.testing.assert_close(loss, l1(image, target) + distance(image, target))
    loss.backward()
    assert image.grad.abs().max() > 0
    check_installed(UpdateSettings(loss="l1+perceptual"))


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"loss": "mse+lpips"}, "'lpips'.*mse, l1, dssim, gram, perceptual"),
        ({"loss": ""}, "joined by"),
        ({"loss": "mse+mse"}, "twice"),
        ({"loss": "x*mse"}, "'x' is no number"),
        ({"loss": "-1*mse"}, "'-1' is no number"),
        ({"loss": "0*mse"}, "no term of a weight above 0"),
        ({"loss": "perceptual", "patch": 16}, "32 pixels or more"),
    ],
)
def test_a_loss_that_cannot_be_fitted_is_refused(wrong, message):
    with pytest.raises(UsageError, match=message):
        UpdateSettings(**wrong)
