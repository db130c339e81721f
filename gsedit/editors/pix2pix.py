"""InstructPix2Pix (Brooks et al. 2023) as a denoiser, from any folder in diffusers' layout.

Of Stable Diffusion 1.5 (one text encoder) or SDXL (two, a pooled feature and the picture's size).
The only file that imports diffusers and transformers. `v` views, `b` views at once, `l d` text
tokens and features, `p` pooled features.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.diffusion import Branches, Need, Prediction, Schedule
from gsedit.editors.protocol import Capabilities
from gsedit.editors.weights import UNWANTED, WANTED, config_of, inspect
from gsedit.errors import InputError, UsageError
from gsedit.views.padding import PadMode

DEFAULT = "timbrooks/instruct-pix2pix"
"""The authors' own weights on the hub."""
PREDICTIONS: dict[str, Prediction] = {"epsilon": "eps", "v_prediction": "v"}
"""By their names in diffusers' configs."""


class Told(NamedTuple):
    """An instruction as the UNet reads it."""

    tokens: Float[Tensor, "l d"]
    pooled: Float[Tensor, " p"] | None = None
    """Of the second text encoder (SDXL)."""


class Condition(NamedTuple):
    """What the UNet is told at every step."""

    images: Float[Tensor, "v c y x"]
    """Latents of the unedited pictures: the posterior's mode, *not* scaled."""
    text: Told
    null: Told
    """The empty instruction."""
    size: tuple[int, int]
    """(height, width) of the pictures, pixels: SDXL is told it."""


@dataclass(frozen=True, eq=False)
class Reader:
    """One text encoder with its tokenizer."""

    encoder: Any
    tokenizer: Any

    def ids(self, text: str) -> Tensor:
        """Token numbers, cut off or filled up to what the encoder reads."""
        return self.tokenizer(
            text,
            padding="max_length",
            max_length=self.tokenizer.model_max_length,
            truncation=True,
            return_tensors="pt",
        ).input_ids

    def excess(self, text: str) -> int:
        """How many tokens of the text would be cut off."""
        found = len(self.tokenizer(text, truncation=False).input_ids)
        return max(0, found - self.tokenizer.model_max_length)


@dataclass(frozen=True, eq=False)
class Pix2Pix:
    """The Denoiser over diffusers' modules, which are used as plain callables."""

    unet: Any
    vae: Any
    readers: tuple[Reader, ...]
    """One of Stable Diffusion, two of SDXL."""
    schedule: Schedule
    predicts: Prediction = "eps"
    micro_batch: int = 1
    """Views in one pass of a network: memory against speed; the result is the same."""
    zeros_for_empty: bool = True
    """SDXL: the empty instruction is zeros, not what the encoders make of it."""
    name: str = "pix2pix"
    padding: PadMode = "mirror"

    @property
    def capabilities(self) -> Capabilities:
        return Capabilities(with_micro_batch=lambda views: replace(self, micro_batch=views))

    @property
    def cell(self) -> int:
        return 2 ** (len(self.vae.config.block_out_channels) - 1)

    @property
    def multiple(self) -> int:
        """Pixels: sides that the VAE and then the UNet can halve to the end without a rest."""
        return self.cell * 2 ** (len(self.unet.config.block_out_channels) - 1)

    @property
    def channels(self) -> int:
        return self.vae.config.latent_channels

    def check(self, prompt: str) -> None:
        """Raise UsageError for an instruction that is empty, or longer than the model can read."""
        if not prompt.strip():
            raise UsageError('the instruction is empty: say what to change, e.g. "make it snow"')
        excess = max(reader.excess(prompt) for reader in self.readers)
        if excess:
            raise UsageError(
                f"the instruction is {excess} tokens (word parts) longer than this model reads, "
                "and its end would be ignored: say it in fewer words"
            )

    @torch.no_grad()
    def encode(self, images: Float[Tensor, "v h w 3"]) -> Float[Tensor, "v c y x"]:
        """The posterior's mode times the VAE's scaling factor, float32."""
        return self._mode(images) * self.vae.config.scaling_factor

    def encode_edited(
        self,
        images: Float[Tensor, "v h w 3"],
        originals: Float[Tensor, "v h w 3"],
        prompt: str,
    ) -> Float[Tensor, "v c y x"]:
        """As encode: these latents say nothing but the picture."""
        return self.encode(images)

    @torch.no_grad()
    def decode(self, latents: Float[Tensor, "v c y x"]) -> Float[Tensor, "v h w 3"]:
        latents = (latents / self.vae.config.scaling_factor).to(self.vae.dtype)
        chunks = [self.vae.decode(z).sample.float() for z in latents.split(self.micro_batch)]
        return torch.cat(chunks).movedim(1, -1) / 2 + 0.5

    @torch.no_grad()
    def condition(
        self, originals: Float[Tensor, "v h w 3"], prompt: str, generator: torch.Generator
    ) -> Condition:
        """Nothing is drawn: `generator` is not used."""
        text, null = self._embed(prompt), self._embed("")
        if text.pooled is not None and self.zeros_for_empty:
            null = Told(torch.zeros_like(text.tokens), torch.zeros_like(text.pooled))
        height, width = originals.shape[1:3]
        return Condition(self._mode(originals), text, null, (height, width))

    @torch.no_grad()
    def branches(
        self, x: Float[Tensor, "v c y x"], t: float, condition: Condition, need: Need
    ) -> Branches:
        """A UNet pass a view for each of (text, image), (null, image), (null, zeros) in need."""
        size = self.micro_batch
        chunks = [
            self._predict(noised, images, t, condition, need)
            for noised, images in zip(x.split(size), condition.images.split(size))
        ]
        predicted = iter(torch.cat(branch) for branch in zip(*chunks))
        return Branches(*(next(predicted) if asked else None for asked in need))

    def _predict(
        self, x: Tensor, images: Tensor, t: float, condition: Condition, need: Need
    ) -> tuple[Tensor, ...]:
        text, null = condition.text, condition.null
        shown = [(text, images), (null, images), (null, torch.zeros_like(images))]
        told, seen = zip(*(branch for branch, asked in zip(shown, need) if asked))
        dtype = self.unet.dtype
        sample = torch.cat((torch.cat([x.to(images)] * len(told)), torch.cat(seen)), 1).to(dtype)
        tokens = torch.cat([each.tokens.expand(len(x), -1, -1) for each in told]).to(dtype)
        added = self._added(told, len(x), condition.size)
        out = self.unet(sample, t, encoder_hidden_states=tokens, added_cond_kwargs=added).sample
        return out.to(x.dtype).chunk(len(told))

    def _added(
        self, told: Sequence[Told], views: int, size: tuple[int, int]
    ) -> dict[str, Tensor] | None:
        """What SDXL is told besides: pooled text; size before scaling, crop corner, size wanted."""
        pooled = [each.pooled.expand(views, -1) for each in told if each.pooled is not None]
        if not pooled:
            return None
        ids = torch.tensor([*size, 0, 0, *size], dtype=self.unet.dtype)
        text = torch.cat(pooled).to(self.unet.dtype)
        return {"text_embeds": text, "time_ids": ids.expand(len(text), -1)}

    @torch.no_grad()
    def _mode(self, images: Tensor) -> Tensor:
        pixels = (2 * images - 1).movedim(-1, 1).to(self.vae.dtype)
        return torch.cat(
            [self.vae.encode(p).latent_dist.mode().float() for p in pixels.split(self.micro_batch)]
        )

    def _embed(self, text: str) -> Told:
        if len(self.readers) == 1:
            reader = self.readers[0]
            return Told(reader.encoder(reader.ids(text))[0][0].float())
        read = [r.encoder(r.ids(text), output_hidden_states=True) for r in self.readers]
        # the last but one layer of both, and the projection of the second: Podell et al. 2023
        tokens = torch.cat([each.hidden_states[-2][0].float() for each in read], -1)
        return Told(tokens, read[-1].text_embeds[0].float())


def load_pix2pix(
    model: str | Path,
    *,
    weights_dir: str | Path | None = None,
    micro_batch: int = 1,
    dtype: torch.dtype = torch.float32,
) -> Pix2Pix:
    """The model of a folder or hub id, looked for on this machine before the hub is asked.

    In order: `model` as a folder, `weights_dir`/`model`, the hub's local cache, the hub. Weights
    are read from safetensors alone. Raises UsageError without diffusers, InputError for a model
    that is missing, incomplete, a pickle or of another kind.
    """
    if micro_batch < 1:
        raise UsageError(f"micro_batch must be 1 or more, not {micro_batch}")
    try:
        import transformers
        from diffusers.models.autoencoders.autoencoder_kl import AutoencoderKL
        from diffusers.models.unets.unet_2d_condition import UNet2DConditionModel
    except ImportError as error:
        raise UsageError(
            f"the pix2pix editor needs diffusers and transformers ({error.name} is missing): "
            "pip install 'gsedit[diffusers]'"
        ) from error
    folder = find(str(model), weights_dir)
    found = inspect(folder).require()
    schedule, predicts = _schedule(folder)

    def load(part: str, kind: Any, **options: Any) -> Any:
        try:
            return kind.from_pretrained(str(folder / part), local_files_only=True, **options)
        except Exception as error:  # these libraries raise whatever their backends do
            reason = next(iter(str(error).strip().splitlines()), type(error).__name__)
            raise InputError(
                f"{folder / part} cannot be loaded ({reason}): download the model again"
            ) from error

    def network(part: str, kind: Any, **options: Any) -> Any:
        options |= {"use_safetensors": True, "variant": found.variant(part)}
        return load(part, kind, **options).eval()

    def reader(part: str, kind: Any) -> Reader:
        words = load(part.replace("text_encoder", "tokenizer"), transformers.CLIPTokenizer)
        return Reader(network(part, kind).to(dtype), words)

    # low_cpu_mem_usage would need one more package (accelerate)
    options = {"torch_dtype": dtype, "low_cpu_mem_usage": False}
    readers = [reader("text_encoder", transformers.CLIPTextModel)]
    if found.kind == "SDXL":
        readers += [reader("text_encoder_2", transformers.CLIPTextModelWithProjection)]
    vae = network("vae", AutoencoderKL, **options)
    if getattr(vae.config, "latents_mean", None) is not None:
        raise InputError(f"{folder / 'vae'}: latents with a mean (latents_mean) are not supported")
    return Pix2Pix(
        unet=network("unet", UNet2DConditionModel, **options),
        vae=vae,
        readers=tuple(readers),
        schedule=schedule,
        predicts=predicts,
        micro_batch=micro_batch,
        zeros_for_empty=_pipeline(folder).get("force_zeros_for_empty_prompt", True),
    )


def find(model: str, weights_dir: str | Path | None = None, *, offline: bool = False) -> Path:
    """The folder that holds the model, whole or not. Raises InputError.

    What the hub's cache holds is taken if it is whole, since the hub can complete it; with
    `offline` the hub is not asked, and what the cache holds is taken as it is.
    """
    places = [Path(model).expanduser()]
    if weights_dir is not None:
        places += [Path(weights_dir).expanduser() / name for name in (model, Path(model).name)]
    for place in places:
        if place.exists():
            return place
    looked = " and ".join(str(place) for place in places)
    if not re.fullmatch(r"[\w.-]+/[\w.-]+", model):
        raise InputError(
            f"{model}: no such model folder (looked for {looked}), and no hub id (like owner/name) "
            "either"
        )
    try:
        from huggingface_hub import constants
    except ImportError:
        raise UsageError(
            "a hub id needs huggingface_hub: pip install 'gsedit[diffusers]'"
        ) from None
    failed = ""
    for local in (True,) if offline else (True, False):
        try:
            folder = _fetch(model, local)
        except Exception as error:  # network, permission and cache errors have no common base
            failed = "" if local else f" and could not be downloaded ({_why(error)})"
            continue
        if offline or not local or inspect(folder).complete:
            return folder
    raise InputError(
        f"{model} is not on this machine (looked for {looked} and in {constants.HF_HUB_CACHE})"
        f"{failed}; {advice(model)}"
    )


def _fetch(model: str, local: bool) -> Path:
    """The folder of the hub's cache, completed from the hub unless `local`."""
    from huggingface_hub import snapshot_download

    wanted = {"allow_patterns": list(WANTED), "ignore_patterns": list(UNWANTED)}
    return Path(snapshot_download(model, local_files_only=local, **wanted))


def advice(model: str) -> str:
    """How to bring a model of the hub to a machine without a network."""
    patterns = [f"--include '{each}'" for each in WANTED]
    patterns += [f"--exclude '{each}'" for each in UNWANTED]
    return (
        "where there is a network, run: "
        f"hf download {model} --local-dir FOLDER {' '.join(patterns)} "
        "(about 4 GB for SD 1.5, 14 GB for SDXL); then bring FOLDER here and add --model FOLDER"
    )


def _why(error: Exception) -> str:
    """The last and most telling line of a network error."""
    name = type(error).__name__
    if "Offline" in name or "LocalEntry" in name:
        return "no network, or HF_HUB_OFFLINE is set"
    if "RepositoryNotFound" in name:
        return "the hub knows no such model, or it needs a login"
    return name


def _pipeline(folder: Path) -> dict[str, Any]:
    """The settings of the whole; none where a folder comes without."""
    path = folder / "model_index.json"
    return config_of(path) if path.exists() else {}


def _schedule(folder: Path) -> tuple[Schedule, Prediction]:
    """(schedule, what is predicted) of the folder's scheduler; Stable Diffusion's without one."""
    path = folder / "scheduler" / "scheduler_config.json"
    config = config_of(path) if path.exists() else {}
    start, end = config.get("beta_start", 0.00085), config.get("beta_end", 0.012)
    steps, kind = config.get("num_train_timesteps", 1000), config.get("beta_schedule")
    told = config.get("prediction_type", "epsilon")
    if told not in PREDICTIONS:
        names = " or ".join(PREDICTIONS)
        raise InputError(f"{path}: prediction_type {told!r} is not {names}")
    if config.get("trained_betas") is not None:
        raise InputError(f"{path}: trained betas are not supported, only a formula")
    if config.get("set_alpha_to_one"):
        raise InputError(f"{path}: set_alpha_to_one must be false, as in Stable Diffusion")
    if kind in (None, "scaled_linear"):
        schedule = Schedule.scaled_linear(start, end, steps)
    elif kind == "linear":
        betas = torch.linspace(start, end, steps, dtype=torch.float64)
        schedule = Schedule((1 - betas).cumprod(0))
    else:
        raise InputError(f"{path}: beta_schedule {kind!r} is not scaled_linear or linear")
    if config.get("rescale_betas_zero_snr"):
        schedule = schedule.zero_terminal_snr()
    return replace(schedule, offset=config.get("steps_offset", 1)), PREDICTIONS[told]
