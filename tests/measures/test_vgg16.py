"""VGG16 against a naive evaluation, and weights files that are refused."""

from math import inf

import pytest
import torch

from gsedit.errors import InputError, UsageError
from gsedit.measures.perceptual import VGG16, Vgg16

EPS32 = torch.finfo(torch.float32).eps


def picture(*shape, seed=0, dtype=torch.float64):
    return torch.rand(*shape, dtype=dtype, generator=torch.Generator().manual_seed(seed))


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


def test_vgg16_equals_the_naive_network(state, weights):
    images = picture(2, 3, 16, 24, dtype=torch.float32)
    layers = Vgg16(weights)(images)
    assert [layer.shape[1] for layer in layers] == [64, 128, 256, 512]
    for n in range(2):
        for layer, expected in zip(layers, naive_vgg16(images[n], state), strict=True):
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
