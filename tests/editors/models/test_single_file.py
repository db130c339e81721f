"""Checkpoints in a single file: equal to the folder that they were made of, or refused."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import diffusers
import pytest
import torch
import transformers
from closeness import NETWORK, assert_near
from gsedit_cli.main import app
from ldm_checkpoints import checkpoint_of
from safetensors.torch import save_file
from small_hub import small_hub
from tiny_models import PROMPT, SD, tiny_text, tiny_tokenizer, tiny_vae, tiny_xl_unet
from typer.testing import CliRunner

from gsedit.diffusion.guidance import Need
from gsedit.diffusion.settings import SamplerSettings
from gsedit.errors import InputError, UsageError
from gsedit.models import families
from gsedit.models.hub import settings_for
from gsedit.models.loading import load_model
from gsedit.models.weights import inspect

pytestmark = pytest.mark.usefixtures("offline")


@pytest.fixture(scope="module")
def two_sizes(tmp_path_factory):
    """A pipeline of SDXL whose text encoders differ in size, by which they are told apart."""
    words, texts = tmp_path_factory.mktemp("two"), [tiny_text(), tiny_text()]
    texts[0].hidden_size, texts[1].hidden_size = 24, 40
    with torch.random.fork_rng():
        torch.manual_seed(3)
        return diffusers.StableDiffusionXLInstructPix2PixPipeline(
            unet=tiny_xl_unet().eval(),
            vae=tiny_vae().eval(),
            text_encoder=transformers.CLIPTextModel(texts[0]).eval(),
            text_encoder_2=transformers.CLIPTextModelWithProjection(texts[1]).eval(),
            tokenizer=tiny_tokenizer(words / "one"),
            tokenizer_2=tiny_tokenizer(words / "two"),
            scheduler=diffusers.DDIMScheduler(**SD),
            add_watermarker=False,
        )


def saved(pipe, place: Path, **more: torch.Tensor) -> tuple[Path, Path]:
    """(single file, its settings and tokenizers beside it, without any weights)."""
    pipe.save_pretrained(place / "a")
    for weights in (place / "a").rglob("*.safetensors"):
        weights.unlink()
    file = place / "a.safetensors"
    save_file(checkpoint_of(pipe) | more, file)
    return file, place / "a"


def seen(model) -> torch.Tensor:
    """An evaluation of every network: what the text, the encoder and the U-Net say."""
    g = torch.Generator().manual_seed(1)
    condition = model.condition(torch.rand(1, 32, 32, 3, generator=g), PROMPT, torch.Generator())
    x = torch.randn(1, 4, 16, 16, generator=g)
    branches = model.branches(x, 500.0, condition, Need())
    return torch.cat([branches.text_image.flatten(), model.decode(x).flatten()])


@pytest.mark.parametrize("name", ["pipeline", "two_sizes"])
def test_a_file_is_equal_to_its_folder(name, tmp_path, request):
    pipe = request.getfixturevalue(name)
    pipe.save_pretrained(tmp_path / "whole")
    file, _ = saved(pipe, tmp_path)
    assert_near(seen(load_model(file)), seen(load_model(tmp_path / "whole")), NETWORK)


def test_cosxl_is_told_and_has_its_own_noise(two_sizes, tmp_path):
    file, _ = saved(two_sizes, tmp_path, **{"edm_vpred.sigma_max": torch.ones(1)})
    model = load_model(file)
    assert model.scaled_images
    assert model.predicts == "v"
    settings = SamplerSettings(steps=4, strength=1.0, spacing="linspace")
    assert model.noise.levels(settings, (16, 16))[0].sigma == pytest.approx(120, rel=1e-3)


def test_averaged_weights_are_taken_where_the_file_has_them(pipeline, tmp_path):
    file, _ = saved(pipeline, tmp_path)
    plain = seen(load_model(file))
    held = checkpoint_of(pipeline)
    begin = "model.diffusion_model."
    averaged = {
        "model_ema." + name.removeprefix("model.").replace(".", ""): value
        for name, value in held.items()
        if name.startswith(begin)
    }
    spoilt = {name: 0 * value for name, value in held.items() if name.startswith(begin)}
    save_file(held | spoilt | averaged, file)
    assert_near(seen(load_model(file)), plain, NETWORK)


def test_the_doctor_on_a_file(pipeline, tmp_path):
    file, _ = saved(pipeline, tmp_path)
    result = CliRunner().invoke(app, ["doctor", str(file)])
    assert result.exit_code == 0
    assert result.stdout.splitlines()[-1] == f"{file}: {families.SD.title}, complete"


def test_settings_that_do_not_fit_are_refused(pipeline, two_sizes, tmp_path):
    file, settings = saved(pipeline, tmp_path)
    (tmp_path / "b").mkdir()
    with pytest.raises(InputError, match="settings of another model"):
        inspect(file, saved(two_sizes, tmp_path / "b")[1]).require()
    (settings / "tokenizer" / "tokenizer.json").unlink(missing_ok=True)
    (settings / "tokenizer" / "vocab.json").unlink(missing_ok=True)
    with pytest.raises(InputError, match="tokenizer has no"):
        load_model(file)
    shutil.rmtree(settings)
    with pytest.raises(
        InputError, match=r"without settings .*hf download timbrooks.*--local-dir a"
    ):
        inspect(file)


def test_a_file_that_lacks_weights(pipeline, tmp_path):
    file, _ = saved(pipeline, tmp_path)
    held = checkpoint_of(pipeline)
    del held["model.diffusion_model.out.2.bias"]
    save_file(held, file)
    with pytest.raises(InputError, match=r"lacks weights of the network in .*unet/config.json"):
        load_model(file)
    vae = {name: value for name, value in held.items() if not name.startswith("first_stage")}
    save_file(vae, file)
    with pytest.raises(InputError, match="holds no vae"):
        load_model(file)


def test_settings_come_from_the_hub_once_it_is_agreed_to(pipeline, tmp_path, monkeypatch):
    file, settings = saved(pipeline, tmp_path)
    (tmp_path / "hub" / "timbrooks").mkdir(parents=True)
    settings.rename(tmp_path / "hub" / families.SD.example)
    with pytest.raises(UsageError, match="timbrooks/instruct-pix2pix, 3 MB: add --yes"):
        settings_for(file)
    code = "import sys, pathlib; from gsedit.models.hub import settings_for; "
    code += "settings_for(pathlib.Path(sys.argv[1]), yes=True)"
    with small_hub(tmp_path / "hub") as hub:  # its library reads its address when it is imported
        env = {"HF_ENDPOINT": hub.url, "HF_HOME": str(tmp_path), "HF_HUB_OFFLINE": "0"}
        subprocess.run([sys.executable, "-c", code, str(file)], env=os.environ | env, check=True)
    monkeypatch.setattr("huggingface_hub.constants.HF_HUB_CACHE", str(tmp_path / "hub"))
    found = settings_for(file)  # of the cache: nothing is asked
    assert json.loads((found / "unet" / "config.json").read_text())["in_channels"] == 8
    assert load_model(file).channels == 4
