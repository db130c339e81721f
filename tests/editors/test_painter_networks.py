"""The networks that paint: equal to the published files, for pictures of any kind."""

from functools import partial
from pathlib import Path

import pytest
import torch
from PIL import Image

from gsedit.errors import InputError, UsageError
from gsedit.paper.editors.painter.editor import WEIGHTS, load_painter
from gsedit.paper.editors.painter.network import (
    LEAST,
    SIDE,
    load_picture_styles,
    mixed,
    read_style_picture,
    style_of,
)
from gsedit.paper.editors.painter.network import WEIGHTS as PICTURE_WEIGHTS

FILES = Path(__file__).parents[3] / "shared/data/weights"
close = partial(torch.testing.assert_close, rtol=1e-4, atol=1e-4)


def waves(height, width):
    rows, columns = torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")
    waves = [torch.sin(rows / (7 + k) + columns / (11 - 2 * k)) for k in range(3)]
    return (torch.stack(waves, -1) + 1) / 2


@torch.no_grad()
def painted(network, style, picture):
    images = network(picture.movedim(-1, 0)[None], style)
    return images[0].movedim(0, -1)


def test_painted_pixels_are_those_of_the_published_file():
    painter = load_painter()
    found = [painted(painter.network, painter.styles[k], waves(64, 96)) for k in (1, 19)]
    expected = torch.tensor([[0.1, 0.07857, 0.08198], [0.14062, 0.2354, 0.31935]])
    close(torch.stack([each[20, 30] for each in found]), expected)


def test_the_style_of_a_picture_is_that_of_the_published_file():
    network, predictor = load_picture_styles()
    vector = predictor(waves(SIDE, SIDE).movedim(-1, 0)[None])[0]
    close(vector[::33], torch.tensor([0.89612, 0.03082, -0.15379, -1.37732]))
    style = predictor.affine(vector)
    found = painted(network, style, waves(384, 384))
    expected = torch.tensor([[0.92367, 0.06428, 0.63098], [0.28648, 0.97464, 0.86996]])
    close(found[(20, 200), (30, 301)], expected)


def test_both_equal_the_published_files():
    pytest.importorskip("onnx")
    pytest.importorskip("onnxruntime")
    if not FILES.is_dir():
        pytest.skip(f"{FILES} is not there")
    from research.convert_painter import differences

    assert max(differences(FILES).values()) < 1e-4


@pytest.mark.parametrize(
    ("size", "fill"),
    [((16, 16), None), ((52, 36), None), ((36, 100), None), ((16, 16), 0.0), ((36, 100), 0.5)],
)
def test_pictures_of_any_size_and_of_one_color(size, fill):
    picture = waves(*size) if fill is None else torch.full((*size, 3), fill)
    painter = load_painter()
    for network, style in (
        (painter.network, painter.styles[8]),
        (load_picture_styles()[0], style_of(picture)),
    ):
        found = painted(network, style, picture)
        assert found.shape == picture.shape
        assert found.isfinite().all()
        assert 0 <= found.min() <= found.max() <= 1


def test_views_agree_after_any_block_where_they_show_the_same_place():
    painter, views = (
        load_painter(),
        torch.stack((waves(32, 32), 1 - waves(32, 32) ** 2)).movedim(-1, 1),
    )

    @torch.no_grad()
    def apart(last):
        def agree(block, x):
            return x.mean(0, keepdim=True).expand_as(x) if block <= last else x

        made = painter.network(views, painter.styles[3], agree)
        return float((made[0] - made[1]).abs().mean())

    assert max(apart(1), apart(6)) < 1e-5 < apart(0)


def test_a_long_picture_has_the_style_of_its_squares():
    square = waves(64, 64)
    for along in (0, 1):
        for a, b in zip(style_of(square), style_of(torch.cat((square, square), along))):
            close(a.gamma, b.gamma)
            close(a.beta, b.beta)


def test_styles_are_mixed_by_their_shares():
    first, second = load_painter().styles[:2]
    for a, b, between in zip(first, second, mixed((first, second), (1.0, 3.0))):
        close(between.gamma, a.gamma / 4 + b.gamma * 3 / 4)
        close(between.beta, a.beta / 4 + b.beta * 3 / 4)
    for shares in ((), (1.0,), (0.0, 0.0), (2.0, -1.0)):
        with pytest.raises(ValueError, match="cannot be mixed"):
            mixed((first, second), shares)


def test_loading_leaves_the_global_generator_alone():
    before = torch.get_rng_state()
    load_painter.__wrapped__()
    load_picture_styles.__wrapped__()
    assert torch.equal(torch.get_rng_state(), before)


@pytest.mark.parametrize("load", [load_painter, load_picture_styles])
@pytest.mark.parametrize("damage", ["missing", "empty", "half", "other"])
def test_weights_that_are_missing_or_damaged(tmp_path, load, damage):
    own, other = WEIGHTS, PICTURE_WEIGHTS
    if load is load_picture_styles:
        own, other = other, own
    path = tmp_path / "weights.safetensors"
    content = {
        "empty": b"", "half": own.read_bytes()[: own.stat().st_size // 2],
        "other": other.read_bytes(),
    }  # fmt: skip
    if damage in content:
        path.write_bytes(content[damage])
    with pytest.raises(InputError, match="install gsedit again") as raised:
        load(path)
    assert str(path) in str(raised.value)
    assert "\n" not in str(raised.value)


def test_a_style_picture_is_upright_over_white_and_not_larger_than_of_use(tmp_path):
    path = tmp_path / "style.png"
    Image.new("RGBA", (40, 60), (255, 0, 0, 0)).save(path)
    assert torch.equal(read_style_picture(path), torch.ones(60, 40, 3))
    Image.new("RGB", (3000, 1500), (255, 0, 0)).save(path)
    assert read_style_picture(path).shape == (512, 1024, 3)
    turned = Image.Exif()
    turned[0x0112] = 6
    Image.new("RGB", (3000, 1500), (255, 0, 0)).save(tmp_path / "style.jpg", exif=turned)
    assert read_style_picture(tmp_path / "style.jpg").shape == (1024, 512, 3)


def test_pictures_without_a_style(tmp_path):
    small, text, huge = (tmp_path / f"{name}.png" for name in ("small", "text", "huge"))
    Image.new("RGB", (8, 300)).save(small)
    with pytest.raises(UsageError, match=rf"8x300 pixels, too few.*bring one of {LEAST}"):
        read_style_picture(small)
    text.write_text("no picture")
    with pytest.raises(InputError, match=r"no readable picture.*copy or export it again"):
        read_style_picture(text)
    Image.new("1", (10_000, 10_000)).save(huge)
    with pytest.raises(InputError, match="64 million are allowed: make it smaller"):
        read_style_picture(huge)
