"""A folder of every family, as its pipeline saves it: inspected, loaded and edited with."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import tiny_flux
import tiny_models
import torch

from gsedit.paper.diffusion.settings import SamplerSettings
from gsedit.paper.editors import EditBatch, make_editor
from gsedit.paper.models.hub import PIPELINES, inspect

pytestmark = pytest.mark.usefixtures("offline")
SIDE = 32
MAKE = {
    "StableDiffusionInstructPix2PixPipeline": tiny_models.tiny_pipeline,
    "StableDiffusionXLInstructPix2PixPipeline": tiny_models.tiny_xl_pipeline,
    "Flux2KleinPipeline": lambda _: tiny_flux.klein(),
}


def saved(name: str, tmp_path: Path):
    """(the pipeline of that class, the folder that it saves)."""
    (tmp_path / "words").mkdir()
    pipe, folder = MAKE[name](tmp_path / "words"), tmp_path / "model"
    pipe.save_pretrained(folder)
    index = folder / "model_index.json"
    index.write_text(json.dumps(json.loads(index.read_text()) | {"_class_name": name}))
    return pipe, folder


@pytest.mark.parametrize("name", PIPELINES)
def test_a_saved_folder_is_edited_with(name, tmp_path):
    pipe, folder = saved(name, tmp_path)
    assert not any(part.problem for part in inspect(folder))
    editor = make_editor("diffusers", model=folder)
    assert editor.capabilities.enlarges
    model = editor.capabilities.denoiser
    for part in (PIPELINES[name].networks[0], "vae"):
        expected, found = (getattr(owner, part).state_dict() for owner in (pipe, model))
        assert expected.keys() == found.keys()
        for key, value in expected.items():
            torch.testing.assert_close(found[key], value, rtol=0, atol=0)
    pictures = torch.rand(2, SIDE, SIDE, 3, generator=torch.Generator().manual_seed(0))
    batch = EditBatch(pictures, pictures, "make it snow")
    *_, last = editor.edit(batch, SamplerSettings(steps=2), torch.Generator().manual_seed(0))
    assert last.images is not None
    assert last.images.shape == pictures.shape
    assert last.images.isfinite().all()
    assert last.evaluations >= 2 * 2
    assert not any(network._network for network in model.text_networks)
