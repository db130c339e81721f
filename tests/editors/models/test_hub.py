"""Models that are found on this machine, or fetched from the hub once that is agreed to."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from small_hub import SmallHub, small_hub

from gsedit.paper.models.loading import load_model

UNET = "diffusion_pytorch_model"


def find(
    hub: SmallHub, cache: Path, yes: str = "False", model: str = "owner/name"
) -> subprocess.CompletedProcess[str]:
    """`find` in a process of its own: the hub's library reads its address when it is imported."""
    code = f"from gsedit.paper.models.hub import find; print(find('{model}', yes={yes}))"
    env = os.environ | {"HF_ENDPOINT": hub.url, "HF_HOME": str(cache), "HF_HUB_OFFLINE": "0"}
    env |= {"HF_HUB_DISABLE_PROGRESS_BARS": "1", "NO_PROXY": "*"}
    return subprocess.run(
        [sys.executable, "-c", code], env=env, capture_output=True, text=True, check=False
    )


def refusal(done: subprocess.CompletedProcess[str]) -> str:
    assert done.returncode
    return done.stderr.strip().splitlines()[-1]


@pytest.fixture
def repository(folder, tmp_path) -> Path:
    """The tiny model on a hub, with files that are no use beside those that are."""
    place = Path(shutil.copytree(folder, tmp_path / "hub" / "owner" / "name"))
    for name in (f"{UNET}.bin", f"{UNET}.fp16.safetensors", f"{UNET}.non_ema.safetensors"):
        (place / "unet" / name).write_bytes(bytes(100))
    (place / "safety_checker").mkdir()
    (place / "safety_checker" / "model.safetensors").write_bytes(bytes(100))
    return place


def test_a_download_is_agreed_to_and_only_what_is_used_is_fetched(repository, tmp_path):
    cache = tmp_path / "cache"
    with small_hub(tmp_path / "hub", licence="openrail") as hub:
        said = refusal(find(hub, cache))
        assert "UsageError" in said
        assert "licence openrail: add --yes" in said
        assert hub.sent < 30_000
        hub.fetched.clear()
        done = find(hub, cache, yes="lambda offer: 'licence openrail' in offer")
        assert done.returncode == 0, done.stderr
        weights = sorted(each for each in hub.fetched if each.endswith(("safetensors", "bin")))
        assert weights == [*[f"{UNET}.safetensors"] * 2, "model.safetensors"]
        hub.fetched.clear()
        again = find(hub, cache)
        assert again.stdout == done.stdout, again.stderr  # whole: the hub is not asked
        assert not hub.fetched
    assert load_model(Path(done.stdout.strip())).vae.config.latent_channels == 4


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("kind", "owner/name is a WanPipeline, which gsedit does not edit"),
        ("pickle", "owner/name/unet has no weights as safetensors"),
        ("gone", "could not be downloaded (the hub knows no such model, or it needs a login"),
    ],
)
def test_what_cannot_be_used_is_said_before_it_is_fetched(repository, tmp_path, change, message):
    match change:
        case "kind":
            index = repository / "model_index.json"
            index.write_text(json.dumps({"_class_name": "WanPipeline"}))
        case "pickle":
            for file in (repository / "unet").glob("*.safetensors"):
                file.unlink()
        case "gone":
            shutil.rmtree(repository)
    with small_hub(tmp_path / "hub") as hub:
        assert message in refusal(find(hub, tmp_path / "cache", yes="True"))
    assert hub.sent < 30_000
