"""A small decoder of the user's: it decodes what the sampler made, or is refused by name."""

from __future__ import annotations

import diffusers
import pytest
import tiny_flux
import torch
from closeness import NETWORK, assert_near

from gsedit.diffusion.settings import SamplerSettings
from gsedit.editors import EditBatch, make_editor
from gsedit.errors import InputError, UsageError

pytestmark = pytest.mark.usefixtures("offline")


def saved(folder, channels: int = 4, levels: int = 2):
    """A decoder of random weights with cells of 2 ** (levels - 1) pixels, and its folder."""
    sizes = {f"{side}_block_out_channels": (8,) * levels for side in ("encoder", "decoder")}
    sizes |= {f"num_{side}_blocks": (1,) * levels for side in ("encoder", "decoder")}
    with torch.random.fork_rng():
        torch.manual_seed(0)
        tiny = diffusers.AutoencoderTiny(latent_channels=channels, scaling_factor=0.5, **sizes)
    tiny.eval().save_pretrained(folder)
    return tiny, folder


def test_it_decodes_what_the_sampler_made(folder, tmp_path):
    tiny, place = saved(tmp_path / "tiny")
    plain = make_editor("pix2pix", model=folder).denoiser
    model = make_editor("pix2pix", model=folder, decoder=place).denoiser
    g = torch.Generator().manual_seed(1)
    latents, pictures = torch.randn(3, 4, 8, 8, generator=g), torch.rand(2, 16, 16, 3, generator=g)
    with torch.no_grad():
        expected = tiny.decode(latents / 0.5).sample.movedim(1, -1) / 2 + 0.5
    assert_near(model.decode(latents), expected, NETWORK)
    assert not torch.allclose(model.decode(latents), plain.decode(latents), atol=0.01)
    assert_near(model.encode(pictures), plain.encode(pictures), NETWORK)


def test_an_edit_with_it_has_whole_pictures(folder, tmp_path):
    editor = make_editor("pix2pix", model=folder, decoder=saved(tmp_path / "tiny")[1])
    pictures = torch.rand(2, 29, 33, 3, generator=torch.Generator().manual_seed(0))
    batch = EditBatch(pictures, pictures, "make it snow")
    *_, last = editor.edit(batch, SamplerSettings(steps=2), torch.Generator().manual_seed(0))
    assert last.images.shape == pictures.shape
    assert last.images.isfinite().all()


@pytest.mark.parametrize(("channels", "levels"), [(16, 2), (4, 3)])
def test_latents_that_it_was_not_made_for(folder, tmp_path, channels, levels):
    _, place = saved(tmp_path / "tiny", channels, levels)
    cell = 2 ** (levels - 1)
    with pytest.raises(UsageError, match=rf"of {channels} channels on cells of {cell} pixels"):
        make_editor("pix2pix", model=folder, decoder=place)


def test_what_is_no_small_decoder(folder, tmp_path):
    with pytest.raises(InputError, match="is a AutoencoderKL, not an AutoencoderTiny"):
        make_editor("pix2pix", model=folder, decoder=folder / "vae")
    with pytest.raises(InputError, match=r"config\.json is missing"):
        make_editor("pix2pix", model=folder, decoder=tmp_path)
    _, place = saved(tmp_path / "tiny")
    weights = place / "diffusion_pytorch_model.safetensors"
    weights.write_bytes(weights.read_bytes()[:-9])
    with pytest.raises(InputError, match="download it again"):
        make_editor("pix2pix", model=folder, decoder=place)
    weights.unlink()
    with pytest.raises(InputError, match="is missing: download it"):
        make_editor("pix2pix", model=folder, decoder=place)


def test_families_without_such_decoders_say_so(tmp_path):
    tiny_flux.klein().save_pretrained(tmp_path / "klein")
    _, place = saved(tmp_path / "tiny")
    with pytest.raises(UsageError, match="--decoder does not fit a Klein model"):
        make_editor("diffusers", model=tmp_path / "klein", decoder=place)
