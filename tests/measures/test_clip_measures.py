"""CLIP's measures: the laws of their formulas, and the loader, on a tiny random model."""

from __future__ import annotations

import json
import shutil
import sys

import pytest
import torch

from gsedit.errors import InputError, UsageError
from gsedit.measures.clip import (
    MEAN,
    STD,
    direction,
    direction_consistency,
    load_clip,
    similarity,
)

pytest.importorskip("transformers")
pytest.importorskip("diffusers")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    from tiny_clip import write_tiny_clip

    return write_tiny_clip(tmp_path_factory.mktemp("weights") / "clip")


@pytest.fixture(scope="module")
def clip(folder):
    return load_clip(folder)


def pictures(count=3, size=32):
    return torch.rand(count, size, size, 3, generator=torch.Generator().manual_seed(0))


def test_the_vectors_are_those_of_transformers(clip):
    """At the model's own size nothing is resized: pictures are standardised and projected."""
    images = pictures()
    values = (images.movedim(-1, 1) - torch.tensor(MEAN)[:, None, None]) / torch.tensor(STD)[
        :, None, None
    ]
    tokens = clip.tokenizer(["a bear", "it is a bronze bear"], padding=True, return_tensors="pt")
    with torch.no_grad():
        whole = clip.model(**tokens, pixel_values=values)
        assert clip.images(images).allclose(whole.image_embeds, atol=1e-5)
        assert clip.texts(["a bear", "it is a bronze bear"]).allclose(whole.text_embeds, atol=1e-5)
    assert clip.images(images).norm(dim=-1).allclose(torch.ones(3))
    assert clip.texts(["a " * 200]).isfinite().all()  # what is too long is cut off


def test_pictures_of_any_shape_are_resized_without_a_crop(clip):
    wide = torch.zeros(1, 20, 60, 3)
    wide[:, :, -8:] = 1  # a crop to the middle would lose it
    assert not clip.images(wide).allclose(clip.images(torch.zeros(1, 20, 60, 3)), atol=1e-4)


def test_a_gradient_reaches_the_pictures_and_not_the_weights(clip):
    images = pictures(1, 40).requires_grad_()
    clip.images(images).sum().backward()
    assert images.grad is not None
    assert images.grad.abs().sum() > 0
    assert all(each.grad is None for each in clip.model.parameters())


def unit(*numbers):
    vector = torch.tensor(numbers, dtype=torch.float32)
    return vector / vector.norm()


def test_direction_is_signed():
    source, target = unit(1, 0, 0), unit(0, 1, 0)
    before = unit(1, 0, 1)[None]
    along = before + 0.1 * (target - source)
    against = before - 0.1 * (target - source)
    assert direction(along, before, target, source).item() == pytest.approx(1)
    assert direction(against, before, target, source).item() == pytest.approx(-1)
    assert direction(before, before, target, source).item() == 0  # nothing changed
    assert direction(along, before, target, target).item() == 0  # nothing was asked for
    assert similarity(target, source).item() == 0


def test_consistency_is_one_where_every_frame_moves_alike():
    before = torch.nn.functional.normalize(pictures(4, 2).reshape(4, -1), dim=-1)
    moved = before + 0.3 * unit(*range(1, 13))
    assert direction_consistency(moved, before).tolist() == pytest.approx([1, 1, 1], abs=1e-5)
    assert direction_consistency(-before, before).tolist() == pytest.approx([-1] * 3, abs=1e-5)
    still = before[:1].expand(4, -1)
    assert direction_consistency(still, before).tolist() == [0, 0, 0]


def broken(folder, tmp_path, change):
    copy = tmp_path / "copy"
    shutil.copytree(folder, copy)
    change(copy)
    return copy


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda f: (f / "config.json").unlink(), "config.json cannot be read"),
        (
            lambda f: (f / "config.json").write_text(json.dumps({"model_type": "bert"})),
            "type 'bert'",
        ),
        (lambda f: (f / "model.safetensors").unlink(), "no .safetensors file"),
        (lambda f: (f / "model.safetensors").write_bytes(b"12345678"), "no readable CLIPModel"),
        (
            lambda f: [each.unlink() for each in (*f.glob("tokenizer.*"), *f.glob("vocab.*"))],
            "no tokenizer",
        ),
    ],
)  # fmt: skip
def test_a_folder_that_is_not_whole_is_refused(folder, tmp_path, change, message):
    with pytest.raises(InputError, match=message):
        load_clip(broken(folder, tmp_path, change))


def test_missing_tensors_are_named(folder, tmp_path):
    from safetensors.torch import load_file, save_file

    def drop(copy):
        state = load_file(copy / "model.safetensors")
        state.pop("visual_projection.weight")
        save_file(state, copy / "model.safetensors", metadata={"format": "pt"})

    with pytest.raises(InputError, match=r"1 tensors .* visual_projection"):
        load_clip(broken(folder, tmp_path, drop))


def test_no_folder_and_no_transformers(folder, tmp_path, monkeypatch):
    with pytest.raises(InputError, match="is no folder"):
        load_clip(tmp_path / "gone")
    load_clip.cache_clear()
    monkeypatch.setitem(sys.modules, "transformers", None)
    with pytest.raises(UsageError, match=r"gsedit\[diffusers\]"):
        load_clip(folder)
