"""The shift-tolerant networks against a naive evaluation, and the laws of the perceptual distance.

The laws hold for tiny random networks; the installed weights, where they are, are held to what was
published of them and to numbers that were measured once.
"""

import sys

import kornia
import pytest
import torch

from gsedit.bench.synthetic import demo_scene, ring_cameras
from gsedit.errors import InputError, UsageError
from gsedit.measures import formulas as metrics
from gsedit.measures import perceptual
from gsedit.measures.perceptual import (
    ALEXNET,
    PerceptualDistance,
    ShiftTolerantAlexNet,
    Vgg16,
    blur_pool,
    perceptual_distance,
    standardised,
    vgg_features,
)

EPS32 = torch.finfo(torch.float32).eps
needs_weights = pytest.mark.skipif(
    not perceptual.is_installed(), reason="the extra `perceptual` (stlpips_pytorch) is absent"
)


def picture(*shape, seed=0):
    return torch.rand(*shape, generator=torch.Generator().manual_seed(seed))


@pytest.fixture(scope="module")
def photo():
    """A photo of the synthetic scene, with edges, texture and flat parts."""
    return demo_scene().trace(ring_cameras(demo_scene(), 4, 96)[0]).image.float()


def random_tensors(shapes, seed=0):
    generator = torch.Generator().manual_seed(seed)
    state = {}
    for name, shape in shapes.items():
        scale = (2 / (shape[1] * shape[2] * shape[3])) ** 0.5
        state[f"{name}.weight"] = torch.randn(*shape, generator=generator) * scale
        state[f"{name}.bias"] = 0.1 * torch.randn(shape[0], generator=generator)
    return state


# ---- the networks --------------------------------------------------------------------------------


def naive_blur(x):
    """Every second pixel of the blurred picture, one at a time."""
    padded = torch.nn.functional.pad(x, (2, 2, 2, 2), mode="reflect")
    kernel = torch.tensor([[1.0, 2, 1], [2, 4, 2], [1, 2, 1]]) / 16
    rows, columns = ((side + 1) // 2 + 1 for side in x.shape[-2:])
    out = x.new_zeros(*x.shape[:2], rows, columns)
    for i in range(rows):
        for j in range(columns):
            patch = padded[..., 2 * i : 2 * i + 3, 2 * j : 2 * j + 3]
            out[..., i, j] = (patch * kernel).sum((-2, -1))
    return out


def test_blur_pooling_is_a_blur_and_every_second_pixel():
    x = picture(2, 3, 9, 12)
    torch.testing.assert_close(blur_pool(x), naive_blur(x))
    flat = torch.full((1, 2, 8, 8), 0.3)
    torch.testing.assert_close(blur_pool(flat), torch.full((1, 2, 5, 5), 0.3))


def test_the_shift_tolerant_vgg_is_a_naive_one():
    """Two blocks, by modules: convolution, ReLU, maximum of 2x2 at every pixel, blur."""
    shapes = {"1.0": (64, 3, 3, 3), "1.2": (64, 64, 3, 3), "2.6": (128, 64, 3, 3)}
    state = random_tensors({f"net.slice{place}": shape for place, shape in shapes.items()})
    images = picture(1, 3, 16, 20)
    first, second = Vgg16(state, ("relu1_2", "relu2_1"))(images)

    def layer(x, name):
        return torch.nn.functional.conv2d(
            x, state[f"{name}.weight"], state[f"{name}.bias"], padding=1
        ).clamp_min(0)

    expected = layer(layer(standardised(images), "net.slice1.0"), "net.slice1.2")
    close = 2 * 576**0.5 * EPS32  # two convolutions of 576 float32 products each, values near 1
    torch.testing.assert_close(first, expected, atol=close, rtol=0)
    highest = expected.unfold(2, 2, 1).unfold(3, 2, 1).amax((4, 5))
    expected = layer(naive_blur(highest), "net.slice2.6")
    torch.testing.assert_close(second, expected, atol=3 * close, rtol=0)


@pytest.fixture(scope="module")
def alex():
    """Random weights and heads of AlexNet."""
    shapes = (
        (64, 3, 11, 11),
        (192, 64, 5, 5),
        (384, 192, 3, 3),
        (256, 384, 3, 3),
        (256, 256, 3, 3),
    )
    names = [name for name, _ in ALEXNET.values()]
    state = random_tensors(dict(zip(names, shapes)))
    for i, (size, *_) in enumerate(shapes):
        state[f"lin{i}.model.1.weight"] = picture(1, size, 1, 1, seed=i) / size
    return state


def test_alexnet_has_the_published_strides(alex):
    state, images = alex, picture(2, 3, 64, 48)
    layers = ShiftTolerantAlexNet(alex)(images)
    # the first convolution takes 6 pixels off, the blur halves and adds 1; each pool takes 2 off
    assert [tuple(x.shape[1:]) for x in layers] == [
        (64, 30, 22), (192, 15, 11), (384, 8, 6), (256, 8, 6), (256, 8, 6)
    ]  # fmt: skip
    conv = torch.nn.functional.conv2d
    first = conv(
        standardised(images), state["net.slice1.0.weight"], state["net.slice1.0.bias"], padding=2
    )
    torch.testing.assert_close(layers[0], naive_blur(first).relu(), atol=1e-5, rtol=1e-5)
    pooled = naive_blur(layers[0].unfold(2, 3, 1).unfold(3, 3, 1).amax((4, 5)))
    second = conv(pooled, state["net.slice2.5.weight"], state["net.slice2.5.bias"], padding=2)
    torch.testing.assert_close(layers[1], second.relu(), atol=1e-4, rtol=1e-4)


# ---- the distance --------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def tiny(alex):
    return PerceptualDistance(ShiftTolerantAlexNet(alex), perceptual.read_heads(alex))


def test_a_distance_is_zero_at_equal_pictures_symmetric_and_a_mean(tiny):
    a, b = picture(2, 40, 48, 3), picture(2, 40, 48, 3, seed=1)
    assert tiny(a, a) == 0
    assert tiny(a, b) > 0
    torch.testing.assert_close(tiny(a, b), tiny(b, a))
    torch.testing.assert_close(tiny(a, b), (tiny(a[0], b[0]) + tiny(a[1], b[1])) / 2)
    image = a[0].clone().requires_grad_()
    tiny(image, b[0]).backward()
    assert image.grad is not None
    assert image.grad.abs().sum() > 0


def test_black_pictures_have_a_distance_too(tiny):
    assert tiny(torch.zeros(32, 32, 3), torch.ones(32, 32, 3)).isfinite()


def test_without_the_package_there_is_no_distance(monkeypatch):
    monkeypatch.setitem(sys.modules, perceptual.PACKAGE, None)  # as if it was not installed
    perceptual_distance.cache_clear()
    try:
        assert metrics.perceptual(picture(32, 32, 3), picture(32, 32, 3)) is None
        with pytest.raises(UsageError, match=r"gsedit\[perceptual\]"):
            perceptual.weights_path(perceptual.VGG)
    finally:
        perceptual_distance.cache_clear()


def test_a_file_with_other_bytes_is_refused(monkeypatch, tmp_path):
    package = tmp_path / perceptual.PACKAGE
    folder = package / "weights" / "vST0.0"
    folder.mkdir(parents=True)
    (package / "__init__.py").write_text("raise ImportError('never imported')")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(InputError, match=r"alex_shift_tolerant\.pth: no such file"):
        perceptual.weights_path(perceptual.ALEX)
    (folder / perceptual.ALEX).write_bytes(b"something else")
    with pytest.raises(InputError, match="not the weights of"):
        perceptual.weights_path(perceptual.ALEX)


@needs_weights
def test_the_installed_distance_grows_with_blur_noise_and_shift(photo):
    distance = perceptual_distance()
    noise = picture(*photo.shape) - 0.5
    blurred = [
        kornia.filters.gaussian_blur2d(photo.movedim(-1, 0)[None], (21, 21), (s, s))[0]
        for s in (0.5, 1.0, 2.0, 4.0)
    ]
    series = {
        "blur": [image.movedim(0, -1) for image in blurred],
        "noise": [(photo + a * noise).clamp(0, 1) for a in (0.03, 0.1, 0.3)],
        "shift": [photo.roll(k, 1) for k in (1, 2, 4, 8)],
    }
    for name, pictures in series.items():
        values = [float(distance(photo, other)) for other in pictures]
        assert values == sorted(values), name
        assert values[0] > 0
    assert metrics.perceptual(photo, photo) == 0


@needs_weights
def test_the_installed_distance_forgives_one_pixel(photo):
    """A shift by one pixel, which nobody sees, counts less than noise that changes as much."""
    distance = perceptual_distance()
    shifted = photo.roll(1, 1)
    faint = photo + metrics.rmse(photo, shifted) * torch.randn(
        photo.shape, generator=torch.Generator().manual_seed(0)
    )
    assert distance(photo, shifted) < distance(photo, faint) / 10
    assert distance(photo, shifted) < 0.05


@needs_weights
def test_the_installed_vgg_has_layers_of_equal_energy(photo):
    image = photo.movedim(-1, 0)[None]
    layers = vgg_features()(image)
    assert [layer.shape[1] for layer in layers] == [64, 128, 256, 512]
    energies = [float(layer.square().mean()) for layer in layers]
    # made equal on noise; a picture with flat parts has less detail, which VGG's middle layers see
    assert max(energies) < 30 * min(energies), energies
