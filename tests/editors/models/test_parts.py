"""Parts of a model's folder: their precision, the memory they take, and what is wrong with them."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import diffusers
import pytest
import torch
from safetensors.torch import load_file, save_file
from transformers import AutoTokenizer

from gsedit.diffusion.guidance import Need
from gsedit.errors import InputError
from gsedit.models import parts as parts_module
from gsedit.models.loading import load_model
from gsedit.models.parts import Parts

pytestmark = pytest.mark.usefixtures("offline")
UNET = "diffusion_pytorch_model.safetensors"


def stored_in(pipeline, folder: Path, dtype: torch.dtype) -> Path:
    """The model with weights of that dtype."""
    pipeline.save_pretrained(folder)
    for file in folder.rglob("*.safetensors"):
        kept = {name: value.to(dtype) for name, value in load_file(file).items()}
        save_file(kept, file, metadata={"format": "pt"})
    return folder


def dtypes(model) -> tuple[torch.dtype, torch.dtype, torch.dtype]:
    encoder = next(model.text_encoders[0].network.network.parameters())
    return model.unet.dtype, model.vae.dtype, encoder.dtype


def test_weights_keep_the_dtype_that_they_are_stored_in(pipeline, tmp_path, monkeypatch):
    full, half = torch.float32, torch.bfloat16
    folder = stored_in(pipeline, tmp_path / "bf16", half)
    assert dtypes(load_model(folder)) == (half, full, half)  # a VAE's roundings would show
    assert dtypes(load_model(folder, precision="float32")) == (full, full, full)
    folder = stored_in(pipeline, tmp_path / "fp16", torch.float16)
    assert dtypes(load_model(folder)) == (full, full, full)
    monkeypatch.setattr(parts_module, "free_bytes", lambda: 1000)
    assert dtypes(load_model(folder)) == (half, full, half)  # float32 would not fit


def test_a_model_in_bfloat16_is_near_the_same(folder, model):
    rounded = load_model(folder, precision="bfloat16")
    g = torch.Generator().manual_seed(0)
    pictures, x = torch.rand(1, 32, 32, 3, generator=g), torch.randn(1, 4, 16, 16, generator=g)
    found, expected = (
        each.predict(x, 500.0, each.condition(pictures, "it snows", g), Need(True, False, False))[0]
        for each in (rounded, model)
    )
    assert found.dtype == torch.float32
    assert (found - expected).norm() < 0.03 * expected.norm()


def anonymous_bytes() -> int:
    """Memory of this process that no file backs."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return int(next(line for line in lines if line.startswith("RssAnon")).split()[1]) * 1024


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="the memory is read from /proc")
def test_weights_are_mapped_not_copied(folder, tmp_path):
    copy = Path(shutil.copytree(folder, tmp_path / "large"))
    config = json.loads((copy / "unet" / "config.json").read_text())
    unet = diffusers.UNet2DConditionModel.from_config(config | {"block_out_channels": [160, 320]})
    unet.save_pretrained(copy / "unet")
    size = sum(p.numel() * 4 for p in unet.parameters())
    assert size > 40e6
    before = anonymous_bytes()
    loaded = Parts.of(copy).network("unet", diffusers.UNet2DConditionModel)
    assert anonymous_bytes() - before < 0.2 * size
    torch.testing.assert_close(loaded.conv_in.weight, unet.conv_in.weight, rtol=0, atol=0)


def changed(folder: Path, tmp_path: Path, part: str, change) -> Path:
    """A copy of a model, the weights of a part of which are changed."""
    copy = Path(shutil.copytree(folder, tmp_path / "changed"))
    file = next((copy / part).glob("*.safetensors"))
    weights = load_file(file)
    change(weights)
    save_file(weights, file, metadata={"format": "pt"})
    return copy


@pytest.mark.parametrize("part", ["unet", "text_encoder", "vae"])
def test_weights_of_another_shape(folder, tmp_path, part):
    def change(weights):
        name = next(name for name, value in weights.items() if value.ndim == 2)
        weights[name] = torch.ones(3, 3)

    with pytest.raises(InputError) as caught:
        load_model(changed(folder, tmp_path, part, change))
    message = str(caught.value)
    assert message.startswith(f"{tmp_path / 'changed' / part} ")
    assert "shape" in message
    assert "3, 3" in message
    assert "download" in message
    assert "\n" not in message
    assert len(message) < 400


@pytest.mark.parametrize("part", ["unet", "text_encoder", "vae"])
def test_weights_that_lack_a_tensor(folder, tmp_path, part):
    with pytest.raises(InputError, match=f"changed/{part} .*download"):
        load_model(changed(folder, tmp_path, part, lambda w: w.pop(sorted(w)[0])))


def test_a_missing_shard(pipeline, tmp_path):
    pipeline.save_pretrained(tmp_path / "shards", max_shard_size="200KB")
    shards = sorted((tmp_path / "shards" / "unet").glob("*.safetensors"))
    assert len(shards) > 1
    assert load_model(tmp_path / "shards").unet is not None
    shards[0].unlink()
    with pytest.raises(InputError, match=f"{shards[0].name} is missing: download it"):
        load_model(tmp_path / "shards")


def test_a_tokenizer_with_code_of_its_own_is_refused_and_not_run(folder, tmp_path, monkeypatch):
    monkeypatch.setattr("builtins.input", lambda *_: pytest.fail("it asks on the terminal"))
    copy = tmp_path / "own"
    shutil.copytree(folder, copy)
    own = {"tokenizer_class": "Own", "auto_map": {"AutoTokenizer": ["own.Own", None]}}
    (copy / "tokenizer" / "tokenizer_config.json").write_text(json.dumps(own))
    (copy / "tokenizer" / "own.py").write_text("raise SystemExit('run')")
    with pytest.raises(InputError, match="custom code"):
        Parts.of(copy).tokenizer("tokenizer", AutoTokenizer)
