"""Laws of the losses and of the features under the Gram term, VGG16 against a naive evaluation."""

from math import inf

import pytest
import torch

from gsedit.errors import InputError, UsageError
from gsedit.measures.features import BINOMIAL, OPPONENT, VGG16, FilterBank, Vgg16
from gsedit.measures.losses import dssim, edit_loss, gram, gram_loss, l1, mse, ssim

EPS32 = torch.finfo(torch.float32).eps


def picture(*shape, seed=0, dtype=torch.float64):
    return torch.rand(*shape, dtype=dtype, generator=torch.Generator().manual_seed(seed))


def smooth(size=64, seed=0):
    """Noise with the 1/f spectrum (1/f^2 in power) of natural pictures, around mid-grey."""
    noise = torch.randn(3, size, size, generator=torch.Generator().manual_seed(seed)).double()
    f = torch.fft.fftfreq(size).double()
    amplitude = (f[:, None].square() + f.square()).clamp_min(1e-12).rsqrt()
    amplitude[0, 0] = 0
    field = torch.fft.ifft2(torch.fft.fft2(noise) * amplitude).real
    return 0.5 + 0.15 * field / field.std()


# ---- pictures ------------------------------------------------------------------------------------


@pytest.mark.parametrize("loss", [mse, l1, dssim])
def test_a_loss_is_zero_at_its_target_and_only_there(loss):
    image = picture(16, 16, 3)
    # kornia adds 1e-12 to SSIM's denominator, which is a few per cent here
    assert abs(loss(image, image)) < 1e-10
    assert loss(image, picture(16, 16, 3, seed=1)) > 0.01
    assert loss(image, picture(16, 16, 3, seed=1)) == loss(picture(16, 16, 3, seed=1), image)


@pytest.mark.parametrize("loss", [mse, l1, dssim])
def test_a_stack_of_pictures_has_the_mean_loss(loss):
    images, targets = picture(3, 16, 16, 3), picture(3, 16, 16, 3, seed=1)
    each = torch.stack([loss(i, t) for i, t in zip(images, targets)])
    torch.testing.assert_close(loss(images, targets), each.mean())


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


def test_gram_loss_is_the_sum_over_layers():
    one, other = ([picture(2, 3, 4, 4, seed=s), picture(2, 5, 2, 2, seed=s)] for s in (0, 1))
    expected = sum(((gram(a) - gram(b)) ** 2).mean() for a, b in zip(one, other))
    torch.testing.assert_close(gram_loss(one, other), expected)
    assert gram_loss(one, one) == 0


def test_edit_loss_is_the_papers_sum():
    image, target, bank = picture(2, 32, 32, 3), picture(2, 32, 32, 3, seed=1), FilterBank(2)
    found, wanted = (bank(t.permute(0, 3, 1, 2)) for t in (image, target))
    expected = mse(image, target) + 0.1 * gram_loss(found, wanted)
    torch.testing.assert_close(edit_loss(image, target, bank), expected)
    assert edit_loss(image, target, bank, gram_weight=0.0) == mse(image, target)
    assert edit_loss(image, image, bank) == 0
    torch.testing.assert_close(edit_loss(image[0], target[0], bank, 0.0), mse(image[0], target[0]))


def test_every_loss_has_its_gradient():
    image, target = picture(8, 8, 3).requires_grad_(), picture(8, 8, 3, seed=1)
    bank = FilterBank(1)
    for loss in (mse, l1, dssim, lambda a, b: edit_loss(a, b, bank, 1.0)):
        assert torch.autograd.gradcheck(lambda t, loss=loss: loss(t, target), image, fast_mode=True)


def test_descending_the_edit_loss_reaches_the_target():
    target, bank = smooth(32, seed=1).permute(1, 2, 0), FilterBank(3)
    image = smooth(32).permute(1, 2, 0).clone().requires_grad_()
    optimiser = torch.optim.Adam([image], lr=0.02)
    start = mse(image.detach(), target)
    for _ in range(60):
        optimiser.zero_grad()
        edit_loss(image, target, bank).backward()
        optimiser.step()
    assert mse(image.detach(), target) < 0.01 * start


# ---- the filter bank -----------------------------------------------------------------------------


def test_layers_are_octaves_of_twelve_channels():
    layers = FilterBank()(picture(2, 3, 64, 48, dtype=torch.float32))
    assert [tuple(f.shape) for f in layers] == [(2, 12, 64, 48), (2, 12, 32, 24), (2, 12, 16, 12)]
    assert len(FilterBank()(picture(1, 3, 64, 64))) == 4


def test_a_flat_picture_has_colour_and_no_edges():
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


def test_channels_have_comparable_energy_on_natural_spectra():
    pictures = torch.stack([smooth(seed=s) for s in range(16)])
    energies = torch.stack([f.square().mean((0, 2, 3)) for f in FilterBank()(pictures)])
    # equal but for what reflection at borders and the missing low frequencies of a patch take away
    assert (energies.amax(1) / energies.amin(1) < 10).all()  # channels of an octave
    assert (energies.amax(0) / energies.amin(0) < 10).all()  # octaves of a channel
    finest = energies[0, [1, 2, 4, 5, 7, 8, 9, 10, 11]]
    torch.testing.assert_close(finest, torch.full_like(finest, 0.15**2), rtol=0.1, atol=0)


def test_a_repeated_texture_moved_by_its_period_has_the_same_gram():
    x = torch.arange(64).double()
    wave = 0.5 + 0.3 * torch.sin(2 * torch.pi * x / 8)
    image = wave.expand(1, 3, 64, 64)
    moved = image.roll(8, 3)
    assert gram_loss(FilterBank()(image), FilterBank()(moved)) < 1e-20
    assert gram_loss(FilterBank()(image), FilterBank()(image.mT)) > 1e-3


def test_a_patch_too_small_and_a_bank_too_short_are_refused():
    with pytest.raises(UsageError, match="8 pixels or more"):
        FilterBank()(picture(1, 3, 7, 64))
    with pytest.raises(UsageError, match="1 or more"):
        FilterBank(0)


# ---- VGG16 ---------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def state():
    """Random weights, torchvision's names and shapes; float16, only to relu4_3, to stay small."""
    generator = torch.Generator().manual_seed(0)
    state = {}
    for number, inputs, outputs in list(VGG16.values())[:10]:
        scale = (2 / (9 * inputs)) ** 0.5  # keeps the size of activations through the layers
        weight = torch.randn(outputs, inputs, 3, 3, generator=generator) * scale
        state[f"features.{number}.weight"] = weight.half()
        state[f"features.{number}.bias"] = torch.rand(outputs, generator=generator).half()
    return state


@pytest.fixture(scope="module")
def weights(state, tmp_path_factory):
    path = tmp_path_factory.mktemp("vgg") / "vgg16.pth"
    torch.save(state, path)
    return path


def naive_vgg16(image, state):
    """torchvision's `features` as a list of modules, by number, convolutions as sums of shifts."""
    mean, std = torch.tensor([0.485, 0.456, 0.406]), torch.tensor([0.229, 0.224, 0.225])
    x = (image.double() - mean[:, None, None]) / std[:, None, None]
    pools, maps = {4, 9, 16}, {}
    for number in range(23):
        if number in pools:
            x = x.unfold(1, 2, 2).unfold(2, 2, 2).amax((3, 4))
        elif f"features.{number}.weight" in state:
            weight, bias = (state[f"features.{number}.{k}"].double() for k in ("weight", "bias"))
            padded = torch.nn.functional.pad(x, (1, 1, 1, 1))
            height, width = x.shape[1:]
            x = bias[:, None, None]
            for i in range(3):
                for j in range(3):
                    shifted = padded[:, i : i + height, j : j + width]
                    x = x + torch.einsum("oi,ihw->ohw", weight[:, :, i, j], shifted)
        else:
            x = x.clamp_min(0)
        maps[number] = x
    return [maps[n] for n in (3, 8, 15, 22)]  # relu1_2, relu2_2, relu3_3, relu4_3


def test_vgg16_is_what_the_naive_network_says(state, weights):
    images = picture(2, 3, 16, 24, dtype=torch.float32)
    found = Vgg16(weights)(images)
    assert [f.shape[1] for f in found] == [64, 128, 256, 512]
    for n in range(2):
        for layer, expected in zip(found, naive_vgg16(images[n], state), strict=True):
            # ten convolutions of up to 4608 float32 products each
            close = 10 * 4608**0.5 * EPS32 * expected.abs().max().item()
            torch.testing.assert_close(layer[n].double(), expected, atol=close, rtol=0)


def test_vgg16_reads_only_what_its_layers_need(state, tmp_path):
    path = tmp_path / "short.pth"
    torch.save({k: v for k, v in state.items() if k.split(".")[1] in ("0", "2")}, path)
    images = picture(1, 3, 8, 8, dtype=torch.float32).requires_grad_()
    (layer,) = Vgg16(path, layers=("relu1_2",))(images)
    layer.sum().backward()
    assert images.grad is not None
    assert images.grad.abs().sum() > 0
    with pytest.raises(InputError, match=r"short\.pth: has no tensor features\.5\.weight"):
        Vgg16(path)
    with pytest.raises(UsageError, match="relu9_9"):
        Vgg16(path, layers=("relu9_9",))


def test_vgg16_reads_safetensors_alike(state, tmp_path):
    from safetensors.torch import save_file

    first = {k: v for k, v in state.items() if k.split(".")[1] == "0"}
    torch.save(first, tmp_path / "a.pth")
    save_file(first, tmp_path / "a.safetensors")
    images = picture(1, 3, 8, 8, dtype=torch.float32)
    (one,), (other,) = (
        Vgg16(tmp_path / name, layers=("relu1_1",))(images) for name in ("a.pth", "a.safetensors")
    )
    assert torch.equal(one, other)


BROKEN = {
    "missing": None,
    "empty": b"",
    "text": b"not weights\n" * 100,
    "truncated zip": b"PK\x03\x04" + bytes(200),
}


@pytest.mark.parametrize("kind", BROKEN)
@pytest.mark.parametrize("suffix", ["pth", "safetensors"])
def test_a_file_that_is_not_weights_is_named_in_one_line(kind, suffix, tmp_path):
    path = tmp_path / f"vgg.{suffix}"
    if BROKEN[kind] is not None:
        path.write_bytes(BROKEN[kind])
    with pytest.raises(InputError) as error:
        Vgg16(path)
    assert str(path) in str(error.value)
    assert "give torchvision's" in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ([1, 2], "holds a list"),
        ({}, "has no tensor features.0.weight"),
        ({"features.0.weight": 3.0}, "has no tensor features.0.weight"),
        ({"features.0.weight": torch.zeros(64, 1, 3, 3)}, r"features.0.weight is \(64, 1, 3, 3\)"),
        ({"features.0.weight": inf}, "has no tensor"),
    ],
)
def test_weights_of_something_else_are_refused(content, message, tmp_path):
    torch.save(content, tmp_path / "other.pth")
    with pytest.raises(InputError, match=message):
        Vgg16(tmp_path / "other.pth")


def test_a_pickle_that_runs_code_is_refused(tmp_path):
    class Trap:
        def __reduce__(self):
            return print, ("executed",)

    torch.save({"features.0.weight": Trap()}, tmp_path / "trap.pth")
    with pytest.raises(InputError, match="not a readable weights file"):
        Vgg16(tmp_path / "trap.pth")
