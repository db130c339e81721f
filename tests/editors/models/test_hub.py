"""Models on the hub: judged by names and small files before any of their weights are fetched."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from small_hub import SmallHub, small_hub

LARGE = 3_000_000
UNET = "diffusion_pytorch_model"
SD = {
    "_class_name": "StableDiffusionInstructPix2PixPipeline",
    "unet": ["diffusers", "UNet2DConditionModel"],
    "scheduler": ["diffusers", "EulerAncestralDiscreteScheduler"],
    "safety_checker": ["stable_diffusion", "StableDiffusionSafetyChecker"],
}


def repository(folder: Path, index: dict, *weights: str) -> Path:
    """A model of the layout of Stable Diffusion, whose weights are `LARGE` bytes a file."""
    configs = {
        "unet/config.json": {"_class_name": "UNet2DConditionModel", "in_channels": 8},
        "vae/config.json": {"_class_name": "AutoencoderKL", "latent_channels": 4},
        "text_encoder/config.json": {"architectures": ["CLIPTextModel"]},
        "tokenizer/vocab.json": {},
        "scheduler/scheduler_config.json": {"_class_name": index.get("scheduler", ["", ""])[1]},
        "safety_checker/config.json": {},
        "model_index.json": index,
    }
    for name, config in configs.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(json.dumps(config))
    (folder / "tokenizer" / "merges.txt").write_text("#version: 0.2\n")
    for name in weights:
        header = json.dumps({name: {"dtype": "U8", "shape": [LARGE], "data_offsets": [0, LARGE]}})
        data = len(header).to_bytes(8, "little") + header.encode() + bytes(LARGE)
        (folder / name).write_bytes(data)
    return folder


WHOLE = (f"unet/{UNET}.safetensors", f"vae/{UNET}.safetensors", "text_encoder/model.safetensors")
UNUSED = (
    f"unet/{UNET}.fp16.safetensors", f"unet/{UNET}.bin", f"unet/{UNET}.non_ema.safetensors",
    "safety_checker/model.safetensors", "single_file.safetensors",
)  # fmt: skip


def find(
    hub: SmallHub, cache: Path, yes: str = "False", model: str = "owner/name"
) -> subprocess.CompletedProcess[str]:
    """`find` in a process of its own: the hub's library reads its address when it is imported."""
    code = f"from gsedit.models.hub import find; print(find('{model}', yes={yes}))"
    env = os.environ | {"HF_ENDPOINT": hub.url, "HF_HOME": str(cache), "HF_HUB_OFFLINE": "0"}
    env |= {"HF_HUB_DISABLE_PROGRESS_BARS": "1", "NO_PROXY": "*"}
    return subprocess.run(
        [sys.executable, "-c", code], env=env, capture_output=True, text=True, check=False
    )


def refusal(done: subprocess.CompletedProcess[str]) -> str:
    assert done.returncode
    return done.stderr.strip().splitlines()[-1]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"_class_name": "WanPipeline"}, "owner/name is a WanPipeline, which gsedit does not edit"),
        (
            {"scheduler": ["diffusers", "FlowMatchEulerDiscreteScheduler"]},
            "its scheduler is of the class FlowMatchEulerDiscreteScheduler",
        ),
        ({"unet": ["diffusers", "UNet3DConditionModel"]}, "its unet is of the class UNet3D"),
    ],
)
def test_another_kind_is_refused_for_less_than_a_megabyte(tmp_path, changes, message):
    repository(tmp_path / "owner" / "name", SD | changes, *WHOLE)
    with small_hub(tmp_path) as hub:
        said = refusal(find(hub, tmp_path / "cache", yes="True"))
    assert message in said
    assert "timbrooks/instruct-pix2pix" in said
    assert hub.sent < 20_000  # 9 MB of weights are there


def test_a_download_is_agreed_to_and_only_what_is_used_is_fetched(tmp_path):
    repository(tmp_path / "owner" / "name", SD, *WHOLE, *UNUSED)
    cache = tmp_path / "cache"
    with small_hub(tmp_path, licence="openrail") as hub:
        said = refusal(find(hub, cache))
        assert "UsageError" in said
        assert "0.0 GB in 10 files, licence openrail: add --yes" in said
        assert hub.sent < 20_000
        hub.fetched.clear()
        done = find(hub, cache, yes="lambda offer: 'licence openrail' in offer")
        assert done.returncode == 0, done.stderr
        folder = Path(done.stdout.strip())
        weights = sorted(each for each in hub.fetched if each.endswith("safetensors"))
        assert weights == [*[f"{UNET}.safetensors"] * 2, "model.safetensors"]
        assert not (folder / "safety_checker").exists()
        hub.fetched.clear()
        again = find(hub, cache)
        assert again.stdout.strip() == str(folder), again.stderr  # whole: the hub is not asked
        assert not hub.fetched


def test_half_precision_is_fetched_where_there_is_no_other(tmp_path):
    half = (f"unet/{UNET}.fp16-00001-of-00001.safetensors", f"vae/{UNET}.fp16.safetensors")
    folder = repository(tmp_path / "owner" / "name", SD, *half, *WHOLE[1:])
    index = {"weight_map": {"a": Path(half[0]).name}}
    (folder / "unet" / f"{UNET}.safetensors.index.fp16.json").write_text(json.dumps(index))
    with small_hub(tmp_path) as hub:
        done = find(hub, tmp_path / "cache", yes="True", model="owner/name@a-branch")
    assert done.returncode == 0, done.stderr
    assert "a-branch" in hub.revisions
    assert "main" not in hub.revisions
    assert Path(half[0]).name in hub.fetched
    assert f"{UNET}.fp16.safetensors" not in hub.fetched


def test_what_cannot_be_used_is_said_before_it_is_fetched(tmp_path):
    repository(tmp_path / "owner" / "name", SD, *WHOLE[1:], f"unet/{UNET}.bin")
    with small_hub(tmp_path) as hub:
        said = refusal(find(hub, tmp_path / "cache", yes="True"))
    assert "owner/name/unet has only pickles" in said
    assert hub.sent < 20_000


def test_a_model_that_the_hub_does_not_know(tmp_path):
    with small_hub(tmp_path) as hub:
        said = refusal(find(hub, tmp_path / "cache", yes="True"))
    assert (
        "could not be downloaded (the hub knows no such model, or it needs a login (hf auth login))"
        in said
    )
