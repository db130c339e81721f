"""Our loop against diffusers' own pipeline on a tiny random model; model folders that are wrong."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import diffusers
import pytest
import torch
import transformers

from gsedit.consistency.correspond import Correspondences
from gsedit.diffusion import Anchor, Need, SamplerSettings, sample
from gsedit.editors import EditBatch, make_editor
from gsedit.editors.pix2pix import hub
from gsedit.editors.pix2pix.load import load_pix2pix
from gsedit.errors import InputError, UsageError

PROMPT = "make it snow"
SD = {
    "beta_start": 0.00085,
    "beta_end": 0.012,
    "beta_schedule": "scaled_linear",
    "clip_sample": False,
    "set_alpha_to_one": False,
    "steps_offset": 1,
}


def tiny_unet() -> diffusers.UNet2DConditionModel:
    return diffusers.UNet2DConditionModel(
        block_out_channels=(32, 64),
        layers_per_block=2,
        sample_size=32,
        in_channels=8,
        out_channels=4,
        down_block_types=("DownBlock2D", "CrossAttnDownBlock2D"),
        up_block_types=("CrossAttnUpBlock2D", "UpBlock2D"),
        cross_attention_dim=32,
    )


def tiny_xl_unet() -> diffusers.UNet2DConditionModel:
    """As SDXL's: it is told six numbers (8 features each) and a pooled text of 32."""
    return diffusers.UNet2DConditionModel(
        block_out_channels=(32, 64),
        layers_per_block=2,
        sample_size=32,
        in_channels=8,
        out_channels=4,
        down_block_types=("DownBlock2D", "CrossAttnDownBlock2D"),
        up_block_types=("CrossAttnUpBlock2D", "UpBlock2D"),
        attention_head_dim=(2, 4),
        use_linear_projection=True,
        addition_embed_type="text_time",
        addition_time_embed_dim=8,
        transformer_layers_per_block=(1, 2),
        projection_class_embeddings_input_dim=8 * 6 + 32,
        cross_attention_dim=64,
    )


def tiny_text() -> transformers.CLIPTextConfig:
    return transformers.CLIPTextConfig(
        bos_token_id=53,
        eos_token_id=54,
        pad_token_id=54,
        hidden_size=32,
        intermediate_size=37,
        num_attention_heads=4,
        num_hidden_layers=2,
        vocab_size=55,
        projection_dim=32,
    )


def tiny_vae() -> diffusers.AutoencoderKL:
    return diffusers.AutoencoderKL(
        block_out_channels=(32, 64),
        in_channels=3,
        out_channels=3,
        down_block_types=("DownEncoderBlock2D",) * 2,
        up_block_types=("UpDecoderBlock2D",) * 2,
        latent_channels=4,
    )


def tiny_tokenizer(folder: Path) -> transformers.CLIPTokenizer:
    """Bytes of a few letters, one merge, and the two special tokens."""
    letters = "abcdefghijklmnopqrstuvwxyz"
    ends = [f"{letter}</w>" for letter in letters]
    words = [*letters, *ends, "it</w>", "<|startoftext|>", "<|endoftext|>"]
    folder.mkdir()
    vocabulary = {word: index for index, word in enumerate(words)}
    (folder / "vocab.json").write_text(json.dumps(vocabulary))
    (folder / "merges.txt").write_text("#version: 0.2\ni t</w>\n")
    return transformers.CLIPTokenizer(
        str(folder / "vocab.json"), str(folder / "merges.txt"), model_max_length=77
    )


@pytest.fixture(scope="module", autouse=True)
def offline(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HF_HUB_OFFLINE", "1")
        patch.setattr("huggingface_hub.constants.HF_HUB_OFFLINE", True)
        patch.setattr("huggingface_hub.constants.HF_HUB_CACHE", str(tmp_path_factory.mktemp("hub")))
        yield


@pytest.fixture(scope="module")
def pipeline(tmp_path_factory):
    with torch.random.fork_rng():
        torch.manual_seed(0)  # the modules offer no generator for their initial weights
        text = transformers.CLIPTextModel(tiny_text())
        pipe = diffusers.StableDiffusionInstructPix2PixPipeline(
            unet=tiny_unet().eval(),
            vae=tiny_vae().eval(),
            text_encoder=text.eval(),
            tokenizer=tiny_tokenizer(tmp_path_factory.mktemp("words") / "tokenizer"),
            scheduler=diffusers.DDIMScheduler(**SD),
            safety_checker=None,
            feature_extractor=None,
            requires_safety_checker=False,
        )
    pipe.set_progress_bar_config(disable=True)
    return pipe


@pytest.fixture(scope="module")
def xl_pipeline(tmp_path_factory):
    words = tmp_path_factory.mktemp("xl_words")
    with torch.random.fork_rng():
        torch.manual_seed(1)
        pipe = diffusers.StableDiffusionXLInstructPix2PixPipeline(
            unet=tiny_xl_unet().eval(),
            vae=tiny_vae().eval(),
            text_encoder=transformers.CLIPTextModel(tiny_text()).eval(),
            text_encoder_2=transformers.CLIPTextModelWithProjection(tiny_text()).eval(),
            tokenizer=tiny_tokenizer(words / "one"),
            tokenizer_2=tiny_tokenizer(words / "two"),
            scheduler=diffusers.DDIMScheduler(**SD),
            add_watermarker=False,
        )
    pipe.set_progress_bar_config(disable=True)
    return pipe


@pytest.fixture(scope="module")
def xl_folder(xl_pipeline, tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("models") / "tiny_xl"
    xl_pipeline.save_pretrained(path)
    return path


@pytest.fixture(scope="module")
def folder(pipeline, tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("models") / "tiny"
    pipeline.save_pretrained(path)
    return path


@pytest.fixture(scope="module")
def model(folder):
    return load_pix2pix(folder)


def images(views: int = 2, side: int = 32) -> torch.Tensor:
    return torch.rand(views, side, side, 3, generator=torch.Generator().manual_seed(1))


def noise(views: int = 2, cells: int = 16) -> torch.Tensor:
    return torch.randn(views, 4, cells, cells, generator=torch.Generator().manual_seed(2))


def ours(model, settings: SamplerSettings, prediction: str = "epsilon") -> torch.Tensor:
    condition = model.condition(images(), PROMPT, torch.Generator())
    *_, state = sample(model, condition, noise(), settings)
    return state.x


def theirs(pipeline, settings: SamplerSettings) -> torch.Tensor:
    return pipeline(
        [PROMPT] * 2,
        image=images().movedim(-1, 1),
        num_inference_steps=settings.steps,
        guidance_scale=settings.scales[0],
        image_guidance_scale=settings.scales[1],
        latents=noise(),
        output_type="latent",
    ).images


@pytest.mark.parametrize(
    ("steps", "s_T", "s_I"), [(4, 7.5, 1.5), (4, 7.5, 1.0), (7, 3.0, 2.0), (1, 7.5, 1.5)]
)
def test_sampling_equals_diffusers(pipeline, model, steps, s_T, s_I):
    settings = SamplerSettings(
        steps=steps, guidance_text=s_T, guidance_image=s_I, strength=1.0, consensus=False
    )
    expected = theirs(pipeline, settings)
    # float32 networks, and betas that diffusers sums in float32; latents are of order 1 to 10
    torch.testing.assert_close(ours(model, settings), expected, rtol=1e-5, atol=1e-4)


@pytest.mark.parametrize("zeros", [True, False])
def test_xl_sampling_equals_diffusers(xl_pipeline, xl_folder, tmp_path, zeros):
    """Pictures higher than wide, so that a swapped size would tell; both kinds of empty text."""
    copy = Path(shutil.copytree(xl_folder, tmp_path / "xl"))
    index = copy / "model_index.json"
    settings = json.loads(index.read_text()) | {"force_zeros_for_empty_prompt": zeros}
    index.write_text(json.dumps(settings))
    pipe = diffusers.StableDiffusionXLInstructPix2PixPipeline(
        **xl_pipeline.components, force_zeros_for_empty_prompt=zeros, add_watermarker=False
    )
    pipe.set_progress_bar_config(disable=True)
    g = torch.Generator().manual_seed(1)
    pictures, start = torch.rand(2, 48, 32, 3, generator=g), torch.randn(2, 4, 24, 16, generator=g)
    expected = pipe(
        [PROMPT] * 2,
        image=pictures.movedim(-1, 1),
        height=48,
        width=32,
        num_inference_steps=4,
        guidance_scale=7.5,
        image_guidance_scale=1.5,
        latents=start,
        output_type="latent",
        # diffusers' own "" fails for several prompts; given by us it is never zeros
        negative_prompt=None if zeros else [""] * 2,
    ).images
    model = load_pix2pix(copy, micro_batch=2)
    condition = model.condition(pictures, PROMPT, torch.Generator())
    request = SamplerSettings(steps=4, strength=1.0, consensus=False)
    *_, state = sample(model, condition, start, request)
    torch.testing.assert_close(state.x, expected, rtol=1e-5, atol=1e-4)
    assert condition.text.tokens.shape == (77, 64)
    assert condition.text.pooled.shape == (32,)
    assert bool((condition.null.tokens == 0).all()) == zeros
    assert bool((condition.null.pooled == 0).all()) == zeros


def test_xl_is_told_the_size_of_the_pictures(xl_folder):
    model = load_pix2pix(xl_folder)
    condition = model.condition(images(), PROMPT, torch.Generator())
    assert condition.size == (32, 32)
    far = condition._replace(size=(1024, 512))
    near, other = (model.branches(noise(), 500.0, each, Need()) for each in (condition, far))
    assert not torch.equal(near.text_image, other.text_image)


def test_the_whole_xl_editor(xl_folder):
    editor = make_editor("pix2pix", model=xl_folder)
    views = torch.rand(2, 30, 33, 3, generator=torch.Generator().manual_seed(1))
    batch = EditBatch(views, views, PROMPT)
    *_, last = editor.edit(batch, SamplerSettings(steps=2), torch.Generator().manual_seed(0))
    assert last.images.shape == views.shape
    assert last.images.isfinite().all()


@pytest.mark.parametrize("steps", [1, 7, 20, 50, 100])
def test_times_equal_diffusers(model, steps):
    scheduler = diffusers.DDIMScheduler(**SD)
    scheduler.set_timesteps(steps)
    assert model.schedule.timesteps(steps) == scheduler.timesteps.tolist()


def test_v_prediction_equals_diffusers(pipeline, folder, tmp_path):
    shutil.copytree(folder, tmp_path / "v")
    config = {**SD, "prediction_type": "v_prediction"}
    diffusers.DDIMScheduler(**config).save_pretrained(tmp_path / "v" / "scheduler")
    settings = SamplerSettings(steps=3, strength=1.0, consensus=False)
    pipe = diffusers.StableDiffusionInstructPix2PixPipeline(
        **{**pipeline.components, "scheduler": diffusers.DDIMScheduler(**config)},
        requires_safety_checker=False,
    )
    pipe.set_progress_bar_config(disable=True)
    expected = theirs(pipe, settings)
    torch.testing.assert_close(
        ours(load_pix2pix(tmp_path / "v"), settings), expected, rtol=1e-5, atol=1e-4
    )


def test_micro_batches_change_nothing(folder, model):
    together = load_pix2pix(folder, micro_batch=3)
    settings = SamplerSettings(steps=2)
    # a batch of another size may take another convolution kernel: roundings only
    torch.testing.assert_close(ours(together, settings), ours(model, settings), rtol=0, atol=1e-4)


def test_condition_is_unscaled_and_start_is_scaled(model):
    condition = model.condition(images(), PROMPT, torch.Generator())
    torch.testing.assert_close(condition.images * 0.18215, model.encode(images()))
    assert condition.text.tokens.shape == condition.null.tokens.shape == (77, 32)
    assert not torch.equal(condition.text.tokens, condition.null.tokens)
    assert condition.text.pooled is None


def test_decode_undoes_the_scaling(pipeline, model):
    z = noise()
    with torch.no_grad():
        expected = pipeline.vae.decode(z / 0.18215).sample.movedim(1, -1) / 2 + 0.5
        torch.testing.assert_close(model.decode(z), expected)


def test_anchored_view_costs_no_pass_and_stays(model):
    known = torch.tensor([True, False])
    start = model.encode(images())
    condition = model.condition(images()[~known], PROMPT, torch.Generator())
    states = sample(
        model, condition, noise(), SamplerSettings(steps=2), anchor=Anchor(known, start)
    )
    *_, state = states
    torch.testing.assert_close(state.x0[0], start[0], rtol=0, atol=1e-5)


def test_the_whole_editor(folder):
    editor = make_editor("pix2pix", model=folder)
    assert editor.cell == 2  # two blocks, one halving
    labels = torch.full((2, 17, 16), -1)
    labels[:, 3:9, 3:9] = torch.arange(36).reshape(6, 6)
    views = torch.rand(2, 33, 32, 3, generator=torch.Generator().manual_seed(1))
    batch = EditBatch(views, views, PROMPT, Correspondences(labels, torch.eye(2), 2))
    *steps, last = editor.edit(batch, SamplerSettings(steps=2), torch.Generator().manual_seed(0))
    assert [progress.images for progress in steps] == [None]
    assert last.images.shape == views.shape
    assert last.images.isfinite().all()
    with pytest.raises(UsageError, match="empty"):
        editor.check("  ")


def test_the_networks_see_whole_sides(folder, model):
    """33 by 29 pixels become 36 by 32: the VAE halves once and the UNet once more."""
    assert (model.cell, model.multiple) == (2, 4)
    editor = make_editor("pix2pix", model=folder)
    seen = []
    unet = editor.denoiser.unet
    handle = unet.register_forward_pre_hook(lambda _, args: seen.append(args[0].shape[2:]))
    views = torch.rand(1, 29, 33, 3, generator=torch.Generator().manual_seed(1))
    *_, last = editor.edit(
        EditBatch(views, views, PROMPT), SamplerSettings(steps=1), torch.Generator().manual_seed(0)
    )
    handle.remove()
    assert set(seen) == {(16, 18)}
    assert last.images.shape == views.shape


def test_half_precision_copies_are_read(pipeline, tmp_path):
    pipeline.save_pretrained(tmp_path / "half", variant="fp16")
    assert not list((tmp_path / "half" / "unet").glob("*model.safetensors"))
    assert load_pix2pix(tmp_path / "half").unet.dtype == torch.float32


def test_pickles_are_never_opened(pipeline, tmp_path):
    pipeline.save_pretrained(tmp_path / "old", safe_serialization=False)
    assert list((tmp_path / "old" / "unet").glob("*.bin"))
    with pytest.raises(InputError, match="a pickle runs whatever code is in it"):
        load_pix2pix(tmp_path / "old")
    with pytest.raises(InputError, match="is a pickle"):
        load_pix2pix(next((tmp_path / "old" / "unet").glob("*.bin")))


def test_an_instruction_that_would_be_cut_off(model):
    model.check("snow " * 4)
    # 20 words of 4 letters: 80 tokens and the two at the ends, of which this model reads 77
    with pytest.raises(UsageError, match=r"5 tokens .* longer than this model reads"):
        model.check("snow " * 20)


def test_found_by_name_in_the_weights_folder(folder):
    assert load_pix2pix("tiny", weights_dir=folder.parent).channels == 4
    assert load_pix2pix("someone/tiny", weights_dir=folder.parent).channels == 4


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
        load_pix2pix(broken(folder, tmp_path, part, **changes))


def test_missing_and_truncated_parts(folder, tmp_path):
    copy = Path(shutil.copytree(folder, tmp_path / "copy"))
    weights = copy / "unet" / "diffusion_pytorch_model.safetensors"
    weights.write_bytes(weights.read_bytes()[:1000])
    with pytest.raises(InputError, match=r"unet/.*cut short"):
        load_pix2pix(copy)
    weights.write_bytes((folder / "unet" / weights.name).read_bytes())
    config = json.loads((copy / "unet" / "config.json").read_text())
    odd = config | {"down_block_types": ["Odd"] * 2}
    (copy / "unet" / "config.json").write_text(json.dumps(odd))
    with pytest.raises(InputError, match="unet cannot be loaded"):
        load_pix2pix(copy)
    (copy / "unet" / "config.json").write_text("{")
    with pytest.raises(InputError, match=r"config\.json cannot be read"):
        load_pix2pix(copy)
    (copy / "unet" / "config.json").write_text(json.dumps(config))
    shutil.rmtree(copy / "vae")
    with pytest.raises(InputError, match="has no vae/"):
        load_pix2pix(copy)


def test_a_model_that_is_nowhere(tmp_path):
    with pytest.raises(InputError, match="no such model folder"):
        load_pix2pix(tmp_path / "nothing" / "here")
    with pytest.raises(InputError) as caught:
        load_pix2pix("owner/name", weights_dir=tmp_path)
    told = str(caught.value)
    for place in ("owner/name", str(tmp_path / "owner" / "name"), str(tmp_path / "name")):
        assert place in told
    assert "could not be downloaded (no network, or HF_HUB_OFFLINE is set)" in told
    assert "hf download owner/name --local-dir FOLDER --include" in told
    assert told.endswith("then bring FOLDER here and add --model FOLDER")
    with pytest.raises(UsageError, match="micro_batch"):
        load_pix2pix(tmp_path, micro_batch=0)


def snapshot(cache: Path, source: Path) -> Path:
    """What a download of owner/name leaves in the hub's cache."""
    model = cache / "models--owner--name"
    (model / "refs").mkdir(parents=True)
    (model / "refs" / "main").write_text("abc")
    return Path(shutil.copytree(source, model / "snapshots" / "abc"))


def test_the_hub_s_cache_comes_before_the_network(folder, tmp_path, monkeypatch):
    monkeypatch.setattr("huggingface_hub.constants.HF_HUB_CACHE", str(tmp_path))
    cached = snapshot(tmp_path, folder)
    asked = []

    def fetch(model: str, local: bool) -> Path:
        asked.append(local)
        if not local:
            raise ConnectionError
        return cached

    monkeypatch.setattr(hub, "_fetch", fetch)
    assert hub.find("owner/name") == cached
    assert asked == [True]
    (cached / "unet" / "diffusion_pytorch_model.safetensors").unlink()  # cut off while it came
    with pytest.raises(InputError, match=r"could not be downloaded \(ConnectionError\)"):
        hub.find("owner/name")
    assert asked == [True, True, False]
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
    model = load_pix2pix(broken(folder, tmp_path, part, **changes))
    assert model.predicts == "v"
    ours = model.schedule.alphas_cumprod
    theirs = diffusers.DDIMScheduler(**SD, rescale_betas_zero_snr=True).alphas_cumprod
    assert float(ours[-1]) == 0
    # float32 there: 1000 products, and roots of differences of nearly equal numbers
    torch.testing.assert_close(ours.float(), theirs, rtol=0, atol=1e-5)
