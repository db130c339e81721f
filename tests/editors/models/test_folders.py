"""Model folders that are found, read, or wrong."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import diffusers
import pytest
import torch
from tiny_models import SD

from gsedit.errors import InputError, UsageError
from gsedit.models import families, hub
from gsedit.models.loading import load_model

pytestmark = pytest.mark.usefixtures("offline")


def test_half_precision_copies_are_read(pipeline, tmp_path):
    pipeline.save_pretrained(tmp_path / "half", variant="fp16")
    assert not list((tmp_path / "half" / "unet").glob("*model.safetensors"))
    assert load_model(tmp_path / "half").unet.dtype == torch.float32


def test_pickles_are_never_opened(pipeline, tmp_path):
    pipeline.save_pretrained(tmp_path / "old", safe_serialization=False)
    assert list((tmp_path / "old" / "unet").glob("*.bin"))
    with pytest.raises(InputError, match="a pickle runs whatever code is in it"):
        load_model(tmp_path / "old")
    with pytest.raises(InputError, match="is a pickle"):
        load_model(next((tmp_path / "old" / "unet").glob("*.bin")))


def test_an_instruction_that_would_be_cut_off(model):
    model.check("snow " * 4)
    # 20 words of 4 letters: 80 tokens and the two at the ends, of which this model reads 77
    with pytest.raises(UsageError, match=r"5 tokens .* longer than this model reads"):
        model.check("snow " * 20)


def test_found_by_name_in_the_weights_folder(folder):
    assert load_model("tiny", weights_dir=folder.parent).channels == 4
    assert load_model("someone/tiny", weights_dir=folder.parent).channels == 4


def broken(folder: Path, tmp_path: Path, part: str, **changes: object) -> Path:
    copy = Path(shutil.copytree(folder, tmp_path / "broken"))
    path = copy / part
    path.write_text(json.dumps({**json.loads(path.read_text()), **changes}))
    return copy


@pytest.mark.parametrize(
    ("part", "changes", "message"),
    [
        ("unet/config.json", {"in_channels": 4}, "not an InstructPix2Pix model.*4 channels"),
        ("scheduler/scheduler_config.json", {"beta_schedule": "cosine"}, "beta_schedule"),
        ("scheduler/scheduler_config.json", {"prediction_type": "sample"}, "prediction_type"),
        ("scheduler/scheduler_config.json", {"trained_betas": [0.1]}, "trained"),
    ],
)
def test_models_of_another_kind(folder, tmp_path, part, changes, message):
    with pytest.raises(InputError, match=message):
        load_model(broken(folder, tmp_path, part, **changes))


def test_missing_and_truncated_parts(folder, tmp_path):
    copy = Path(shutil.copytree(folder, tmp_path / "copy"))
    weights = copy / "unet" / "diffusion_pytorch_model.safetensors"
    weights.write_bytes(weights.read_bytes()[:1000])
    with pytest.raises(InputError, match=r"unet/.*cut short"):
        load_model(copy)
    weights.write_bytes((folder / "unet" / weights.name).read_bytes())
    config = json.loads((copy / "unet" / "config.json").read_text())
    odd = config | {"down_block_types": ["Odd"] * 2}
    (copy / "unet" / "config.json").write_text(json.dumps(odd))
    with pytest.raises(InputError, match="unet cannot be loaded"):
        load_model(copy)
    (copy / "unet" / "config.json").write_text("{")
    with pytest.raises(InputError, match=r"config\.json: line 1"):
        load_model(copy)
    (copy / "unet" / "config.json").write_text(json.dumps(config))
    shutil.rmtree(copy / "vae")
    with pytest.raises(InputError, match="has no vae/"):
        load_model(copy)


def test_a_model_that_is_nowhere(tmp_path):
    with pytest.raises(InputError, match="no such model folder"):
        load_model(tmp_path / "nothing" / "here")
    with pytest.raises(InputError) as caught:
        load_model("owner/name", weights_dir=tmp_path)
    message = str(caught.value)
    for place in ("owner/name", str(tmp_path / "owner" / "name"), str(tmp_path / "name")):
        assert place in message
    assert "could not be downloaded (no network, or HF_HUB_OFFLINE is set)" in message
    assert "hf download owner/name --local-dir FOLDER --include" in message
    assert message.endswith("then bring FOLDER here and add --model FOLDER")
    with pytest.raises(UsageError, match="micro_batch"):
        load_model(tmp_path, micro_batch=0)


def snapshot(cache: Path, source: Path) -> Path:
    """Files that a download of owner/name leaves in the hub's cache."""
    model = cache / "models--owner--name"
    (model / "refs").mkdir(parents=True)
    (model / "refs" / "main").write_text("abc")
    return Path(shutil.copytree(source, model / "snapshots" / "abc"))


def test_the_hub_s_cache_comes_before_the_network(folder, tmp_path, monkeypatch):
    monkeypatch.setattr("huggingface_hub.constants.HF_HUB_CACHE", str(tmp_path))
    cached = snapshot(tmp_path, folder)
    asked = []

    def offer(model: str) -> hub.Offer:
        asked.append(model)
        raise hub.Unreachable("no network")

    monkeypatch.setattr(hub, "offer_of", offer)
    assert hub.find("owner/name") == cached
    assert not asked
    (cached / "unet" / "diffusion_pytorch_model.safetensors").unlink()  # cut off while it came
    with pytest.raises(InputError, match=r"could not be downloaded \(no network\)"):
        hub.find("owner/name")
    assert asked == ["owner/name"]
    assert hub.find("owner/name", offline=True) == cached  # for the doctor to look at


def test_the_real_cache_is_found(folder, tmp_path, monkeypatch):
    """The layout above is the hub's own: its library finds it."""
    cached = snapshot(tmp_path, folder)
    from huggingface_hub import snapshot_download

    found = snapshot_download("owner/name", cache_dir=tmp_path, local_files_only=True)
    assert Path(found) == cached


def test_zero_terminal_snr_is_read(folder, tmp_path):
    part = "scheduler/scheduler_config.json"
    changes = {"rescale_betas_zero_snr": True, "prediction_type": "v_prediction"}
    model = load_model(broken(folder, tmp_path, part, **changes))
    assert model.predicts == "v"
    ours = model.schedule.alphas_cumprod
    theirs = diffusers.DDIMScheduler(**SD, rescale_betas_zero_snr=True).alphas_cumprod
    assert float(ours[-1]) == 0
    # float32 there: 1000 products, and roots of differences of nearly equal numbers
    torch.testing.assert_close(ours.float(), theirs, rtol=0, atol=1e-5)


def test_a_download_that_does_not_fit_on_the_disk_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("huggingface_hub.constants.HF_HUB_CACHE", str(tmp_path / "hub"))
    offer = hub.Offer("owner/name", families.SD, ("model_index.json",), 10**18, "mit")
    monkeypatch.setattr(hub, "offer_of", lambda model: offer)
    with pytest.raises(
        UsageError, match=r"1,000,000,000\.0 GB in 1 files.* GB are free in .*hub: "
    ):
        hub.find("owner/name", yes=True)
