"""Folders of models: loaded as they are stored, or refused with the next move."""

from __future__ import annotations

import gc
import json
import shutil
import weakref
from pathlib import Path

import diffusers
import pytest
import torch
import transformers
from safetensors.torch import load_file, save_file

from gsedit.errors import InputError, UsageError
from gsedit.paper.models import loading
from gsedit.paper.models.hub import find, inspect
from gsedit.paper.models.loading import Parts, load_model

pytestmark = pytest.mark.usefixtures("offline")
UNET = "diffusion_pytorch_model"


@pytest.fixture
def copy(folder, tmp_path) -> Path:
    """A model's folder to damage."""
    return Path(shutil.copytree(folder, tmp_path / "model"))


def changed(path: Path, **changes: object) -> None:
    path.write_text(json.dumps({**json.loads(path.read_text()), **changes}))


def dtypes(model) -> tuple[torch.dtype, torch.dtype, torch.dtype]:
    encoder = next(model.text_encoders[0].network.network.parameters())
    return model.unet.dtype, model.vae.dtype, encoder.dtype


def stored_in(pipeline, folder: Path, dtype: torch.dtype) -> Path:
    """The model with weights of that dtype."""
    pipeline.save_pretrained(folder)
    for file in folder.rglob("*.safetensors"):
        kept = {name: value.to(dtype) for name, value in load_file(file).items()}
        save_file(kept, file, metadata={"format": "pt"})
    return folder


def test_weights_keep_the_dtype_that_they_are_stored_in(pipeline, tmp_path, monkeypatch):
    full, half = torch.float32, torch.bfloat16
    folder = stored_in(pipeline, tmp_path / "bf16", half)
    assert dtypes(load_model(folder)) == (half, full, half)  # a VAE's roundings would show
    assert dtypes(load_model(folder, precision="float32")) == (full, full, full)
    folder = stored_in(pipeline, tmp_path / "fp16", torch.float16)
    assert dtypes(load_model(folder)) == (full, full, full)
    monkeypatch.setattr(loading, "free_bytes", lambda: 1000)
    assert dtypes(load_model(folder)) == (half, full, half)  # float32 would not fit
    with pytest.raises(UsageError, match=r"GB of memory in float32, and 0\.0 GB are free"):
        load_model(folder, precision="float32")


def anonymous_bytes() -> int:
    """Memory of this process that no file backs."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return int(next(line for line in lines if line.startswith("RssAnon")).split()[1]) * 1024


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="the memory is read from /proc")
def test_weights_are_mapped_not_copied(copy):
    config = json.loads((copy / "unet" / "config.json").read_text())
    unet = diffusers.UNet2DConditionModel.from_config(config | {"block_out_channels": [160, 320]})
    unet.save_pretrained(copy / "unet")
    size = sum(p.numel() * 4 for p in unet.parameters())
    before = anonymous_bytes()
    loaded = Parts.of(copy).network("unet")
    assert anonymous_bytes() - before < 0.2 * size
    torch.testing.assert_close(loaded.conv_in.weight, unet.conv_in.weight, rtol=0, atol=0)


def test_half_precision_copies_and_shards_are_read(pipeline, tmp_path):
    pipeline.save_pretrained(tmp_path / "half", variant="fp16")
    assert not list((tmp_path / "half" / "unet").glob("*model.safetensors"))
    assert load_model(tmp_path / "half").unet.dtype == torch.float32
    pipeline.save_pretrained(tmp_path / "shards", max_shard_size="200KB")
    shards = sorted((tmp_path / "shards" / "unet").glob("*.safetensors"))
    assert len(shards) > 1
    assert load_model(tmp_path / "shards").unet is not None
    shards[0].unlink()
    with pytest.raises(InputError, match=f"{shards[0].name} is missing: download it"):
        load_model(tmp_path / "shards")
    table = tmp_path / "shards" / "unet" / f"{UNET}.safetensors.index.json"
    changed(table, weight_map={"a": "../../other.safetensors"})
    with pytest.raises(InputError, match="no file beside it"):
        load_model(tmp_path / "shards")


@pytest.mark.parametrize("kind", ["folder", "xl_folder"])
def test_text_encoders_are_freed_once_a_text_is_read_and_loaded_for_another(kind, request):
    folder = request.getfixturevalue(kind)
    model, picture = load_model(folder), torch.rand(1, 32, 32, 3)
    networks = [weakref.ref(each.network) for each in model.text_networks]
    first = model.condition(picture, "make it snow", torch.Generator())
    gc.collect()
    assert [each() for each in networks] == [None] * len(networks)
    model.condition(picture, "make it snow", torch.Generator())
    assert not any(each._network for each in model.text_networks)
    second = model.condition(picture, "it snows", torch.Generator())
    assert not torch.equal(second.text.tokens, first.text.tokens)


# ---- what is wrong -------------------------------------------------------------------------------


def damage(model: Path, how: str) -> None:
    unet = model / "unet" / f"{UNET}.safetensors"
    match how:
        case "cut":
            unet.write_bytes(unet.read_bytes()[:-7])
        case "header":
            unet.write_bytes(unet.read_bytes()[:50])
        case "page":
            unet.write_text("<html>404: not found</html>" * 9)
        case "pickle":
            unet.rename(unet.with_suffix(".bin"))
        case "gone":
            unet.unlink()
        case "config":
            (model / "vae" / "config.json").write_text("{")
        case "no config":
            (model / "vae" / "config.json").unlink()
        case "folder":
            shutil.rmtree(model / "tokenizer")


@pytest.mark.parametrize(
    ("how", "message"),
    [
        ("cut", "is no whole safetensors file .*: download it again"),
        ("header", "is no whole safetensors file"),
        ("page", "is no whole safetensors file"),
        ("pickle", "has only pickles: a pickle runs whatever code is in it"),
        ("gone", rf"has no {UNET}\.safetensors: download it"),
        ("config", r"vae/config\.json: line 1"),
        ("no config", r"vae/config\.json is missing: download"),
        ("folder", "tokenizer is missing: download"),
    ],
)
def test_what_is_wrong_is_found_without_loading(copy, how, message):
    damage(copy, how)
    with pytest.raises(InputError, match=message) as caught:
        load_model(copy)
    assert "\n" not in str(caught.value)
    (part,) = (part.name for part in inspect(copy) if part.problem)
    assert part == {"config": "vae", "no config": "vae", "folder": "tokenizer"}.get(how, "unet")


def test_a_model_that_is_nowhere_comes_with_the_command_that_fetches_it(monkeypatch, tmp_path):
    monkeypatch.setattr("huggingface_hub.constants.HF_HUB_CACHE", str(tmp_path))
    with pytest.raises(InputError, match=r"hf download owner/name --revision main .*FOLDER"):
        find("owner/name@main")
    with pytest.raises(InputError, match="no such model folder, and no hub id"):
        find("nowhere at all")


@pytest.mark.parametrize(
    ("part", "changes", "message"),
    [
        ("model_index.json", {"_class_name": "WanPipeline"}, "is a WanPipeline, which gsedit does"),
        ("model_index.json", {"unet": ["own", "Own"]}, "unet is no class of diffusers"),
        ("model_index.json", {"unet": ["diffusers", "Odd"]}, "diffusers has no Odd"),
        ("unet/config.json", {"down_block_types": ["Odd"] * 2}, "unet cannot be loaded"),
        ("unet/config.json", {"cross_attention_dim": 16}, "unet .*download"),
        ("vae/config.json", {"latent_channels": 2}, "vae .*download"),
        ("text_encoder/config.json", {"intermediate_size": 9}, "text_encoder has weights of anot"),
        ("scheduler/scheduler_config.json", {"_class_name": "Odd"}, "is a Odd, which gsedit"),
    ],
)
def test_models_of_another_kind(copy, part, changes, message):
    changed(copy / part, **changes)
    with pytest.raises(InputError, match=message):
        load_model(copy)


def test_a_tokenizer_with_code_of_its_own_is_refused_and_not_run(copy, monkeypatch):
    monkeypatch.setattr("builtins.input", lambda *_: pytest.fail("it asks on the terminal"))
    own = {"tokenizer_class": "Own", "auto_map": {"AutoTokenizer": ["own.Own", None]}}
    (copy / "tokenizer" / "tokenizer_config.json").write_text(json.dumps(own))
    (copy / "tokenizer" / "own.py").write_text("raise SystemExit('run')")
    with pytest.raises(InputError, match="custom code"):
        Parts.of(copy).tokenizer("tokenizer", transformers.AutoTokenizer)
