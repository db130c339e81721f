"""Whether a folder of weights is complete, without loading it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import torch
from gsedit_cli.main import app
from safetensors.torch import save_file
from typer.testing import CliRunner

from gsedit.errors import InputError
from gsedit.models import families
from gsedit.models.headers import tensors
from gsedit.models.weights import inspect


def gsedit(*words: object):
    return CliRunner().invoke(app, [str(word) for word in words])


@pytest.fixture
def model(tmp_path) -> Path:
    """The layout of an InstructPix2Pix, with weights of a few bytes."""
    folder = tmp_path / "model"
    configs = {
        "unet": {"in_channels": 8},
        "vae": {"latent_channels": 4},
        "text_encoder": {},
        "scheduler": {},
    }
    for part, config in configs.items():
        (folder / part).mkdir(parents=True)
        name = "scheduler_config.json" if part == "scheduler" else "config.json"
        (folder / part / name).write_text(json.dumps(config))
    weights = {"conv_in.weight": torch.ones(4, 8, 3, 3), "b": torch.ones(5, dtype=torch.float16)}
    for part, stem in (("unet", UNET), ("vae", UNET), ("text_encoder", "model")):
        save_file(weights, folder / part / f"{stem}.safetensors")
    (folder / "tokenizer").mkdir()
    for name in ("vocab.json", "merges.txt"):
        (folder / "tokenizer" / name).write_text("{}")
    return folder


UNET = "diffusion_pytorch_model"


def test_a_whole_model(model):
    found = inspect(model).require()
    assert found.complete
    assert found.family == families.SD
    assert not found.notes
    assert [part.name for part in found.parts] == ["unet", "vae", "text_encoder", "tokenizer"]
    size = (model / "unet" / f"{UNET}.safetensors").stat().st_size
    assert (found.parts[0].size, found.parts[0].variant) == (size, None)
    assert found.parts[0].stored == "F32"
    assert tensors(model / "vae" / f"{UNET}.safetensors") == {
        "conv_in.weight": ("F32", (4, 8, 3, 3), 4 * 8 * 9 * 4),
        "b": ("F16", (5,), 10),
    }


def test_an_xl_model_has_two_of_each(model):
    (model / "unet" / "config.json").write_text(
        json.dumps({"in_channels": 8, "addition_embed_type": "text_time"})
    )
    found = inspect(model)
    assert found.family == families.SDXL
    assert [part.name for part in found.parts if part.problems] == ["text_encoder_2", "tokenizer_2"]
    with pytest.raises(InputError, match=r"has no text_encoder_2/.*\(and 1 more: gsedit doctor"):
        found.require()


def test_half_precision_copies_and_shards_are_found(model):
    unet = model / "unet"
    (unet / f"{UNET}.safetensors").rename(unet / f"{UNET}.fp16.safetensors")
    assert inspect(model).part("unet").variant == "fp16"
    names = [f"{UNET}-0000{i}-of-00002.safetensors" for i in (1, 2)]
    for name in names:
        save_file({name: torch.ones(2)}, unet / name)
    index = {"weight_map": dict.fromkeys("ab", names[0]) | {"c": names[1]}}
    (unet / f"{UNET}.safetensors.index.json").write_text(json.dumps(index))
    found = inspect(model)
    assert found.complete
    assert found.parts[0].files == tuple(f"unet/{name}" for name in names)
    (unet / names[1]).unlink()
    assert inspect(model).problems == (f"{unet / names[1]} is missing: download it",)


def cut(path: Path, size: int) -> None:
    path.write_bytes(path.read_bytes()[:size])


def damage(model: Path, how: str) -> None:
    unet = model / "unet" / f"{UNET}.safetensors"
    match how:
        case "data":
            cut(unet, unet.stat().st_size - 7)
        case "header":
            cut(unet, 50)
        case "empty":
            cut(unet, 0)
        case "longer":
            unet.write_bytes(unet.read_bytes() + b"more")
        case "page":
            unet.write_text("<html>404: not found</html>" * 9)
        case "pointer":
            unet.write_text("version https://git-lfs.github.com/spec/v1\noid sha256:12\nsize 9\n")
        case "pickle":
            unet.rename(unet.with_suffix(".bin"))
        case "gone":
            unet.unlink()
        case "config":
            (model / "vae" / "config.json").write_text("{")
        case "no config":
            (model / "vae" / "config.json").unlink()
        case "plain":
            (unet.parent / "config.json").write_text('{"in_channels": 4}')
        case "other":
            save_file({"conv_in.weight": torch.ones(4, 4, 3, 3)}, unet)
        case "words":
            (model / "tokenizer" / "merges.txt").unlink()


@pytest.mark.parametrize(
    ("how", "message"),
    [
        ("data", r"has 1,\d+ bytes of the 1,\d+ bytes that its header names: download it again"),
        ("header", r"cut short inside its header \(50 bytes\)"),
        ("empty", r"cut short inside its header \(0 bytes\)"),
        ("longer", "that its header names"),
        ("page", "is no safetensors file"),
        ("pointer", "is a Git LFS pointer, not weights: run 'git lfs pull'"),
        ("pickle", r"has only \S+\.bin: a pickle runs whatever code is in it.*safetensors"),
        ("gone", rf"has no {UNET}\.safetensors: download it"),
        ("config", r"vae/config\.json: line 1"),
        ("no config", r"vae/config\.json is missing"),
        ("plain", r"not an InstructPix2Pix model \(its unet takes 4 channels, not 8\)"),
        ("other", "takes 4 channels and its config.json says 8: the two are of different models"),
        ("words", r"tokenizer has no merges\.txt"),
    ],
)
def test_what_is_wrong_is_found_without_loading(model, how, message):
    damage(model, how)
    with pytest.raises(InputError, match=message):
        inspect(model).require()
    result = gsedit("doctor", model)
    assert result.exit_code == 3
    assert "incomplete, 1 problems" in result.stdout
    record = json.loads(gsedit("doctor", model, "--json").stdout)
    assert not record["complete"]
    (part,) = (part for part in record["parts"] if part["problems"])
    named = {"words": "tokenizer", "config": "vae", "no config": "vae"}
    assert part["name"] == named.get(how, "unet")


@pytest.mark.parametrize("name", ["../../other.safetensors", "/etc/passwd"])
def test_shards_outside_of_their_folder_are_not_read(model, name):
    unet = model / "unet"
    (unet / f"{UNET}.safetensors").unlink()
    table = unet / f"{UNET}.safetensors.index.json"
    table.write_text(json.dumps({"weight_map": {"a": name}}))
    with pytest.raises(InputError, match="no file beside it"):
        inspect(model).require()


def test_a_single_file_of_another_kind(tmp_path):
    name = "model.diffusion_model.input_blocks.0.0.weight"
    save_file({name: torch.ones(4, 4, 3, 3)}, tmp_path / "a.safetensors")
    with pytest.raises(InputError, match=r"no InstructPix2Pix model \(its unet takes 4 channels"):
        inspect(tmp_path / "a.safetensors")


def test_other_single_files(tmp_path):
    for name, message in (("a.ckpt", "is a pickle"), ("a.safetensors", "cut short")):
        (tmp_path / name).write_bytes(b"")
        with pytest.raises(InputError, match=message):
            inspect(tmp_path / name)
    save_file({"lora": torch.ones(2)}, tmp_path / "lora.safetensors")
    with pytest.raises(InputError, match="no checkpoint of Stable Diffusion"):
        inspect(tmp_path / "lora.safetensors")
    with pytest.raises(InputError, match="no such folder"):
        inspect(tmp_path / "nowhere")


def test_the_doctor_on_weights(model):
    (model / "unet" / "extra.bin").write_bytes(b"pickle")
    (model / "scheduler" / "scheduler_config.json").unlink()
    result = gsedit("doctor", model)
    assert result.exit_code == 0
    assert result.stdout.splitlines()[-1] == f"{model}: {families.SD.title}, complete"
    assert "unet/extra.bin: left alone" in result.stdout
    assert "Stable Diffusion's own schedule" in result.stdout
    result = gsedit("doctor", model / "nothing" / "here")
    assert result.exit_code == 3
    assert "no such model folder" in result.stderr
