"""InstructPix2Pix (Brooks et al. 2023) as a denoiser, from any folder in diffusers' layout.

The only file that imports diffusers and transformers. `v` views, `b` views at once, `l d` text
tokens and features.
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.diffusion import Branches, Schedule
from gsedit.errors import InputError, UsageError

PARTS = ("unet", "vae", "text_encoder", "tokenizer")  # no safety checker, no feature extractor
FILES = tuple(f"{p}/*" for p in (*PARTS, "scheduler"))
SKIPPED = ("*.bin", "*.ckpt", "*.fp16.*", "*.non_ema.*", "*.msgpack", "*.h5")  # second copies


class Condition(NamedTuple):
    """What the UNet is told at every step."""

    images: Float[Tensor, "v c y x"]
    """Latents of the unedited pictures: the posterior's mode, *not* scaled."""
    text: Float[Tensor, "l d"]
    null: Float[Tensor, "l d"]
    """The text features of the empty instruction."""


@dataclass(frozen=True, eq=False)
class Pix2Pix:
    """The Denoiser over diffusers' modules, which are used as plain callables."""

    unet: Any
    vae: Any
    text_encoder: Any
    tokenizer: Any
    schedule: Schedule
    prediction: str = "epsilon"
    """epsilon or v_prediction (Salimans and Ho 2022)."""
    micro_batch: int = 1
    """Views in one pass of a network: memory against speed; the result is the same."""
    name: str = "pix2pix"

    @property
    def cell(self) -> int:
        return 2 ** (len(self.vae.config.block_out_channels) - 1)

    @property
    def channels(self) -> int:
        return self.vae.config.latent_channels

    def check(self, prompt: str) -> None:
        """Raise UsageError for an empty instruction; any other is for the model to interpret."""
        if not prompt.strip():
            raise UsageError('the instruction is empty: say what to change, e.g. "make it snow"')

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
        return Condition(self._mode(originals), self._embed(prompt), self._embed(""))

    @torch.no_grad()
    def branches(
        self, x: Float[Tensor, "v c y x"], t: int, condition: Condition, need_none: bool
    ) -> Branches:
        """Two or three UNet passes a view: (text, image), (null, image) and (null, zeros)."""
        size = self.micro_batch
        chunks = [
            self._predict(noised, images, t, condition, need_none)
            for noised, images in zip(x.split(size), condition.images.split(size))
        ]
        eps = [torch.cat(branch) for branch in zip(*chunks)]
        if self.prediction == "v_prediction":
            ab = self.schedule.alpha(t)
            eps = [ab**0.5 * v + (1 - ab) ** 0.5 * x for v in eps]
        return Branches(eps[0], eps[1], eps[2] if need_none else None)

    def answer(self, prompt: str, edited: Tensor, originals: Tensor) -> None:
        """Nobody knows what a network should have answered."""

    def _predict(
        self, x: Tensor, images: Tensor, t: int, condition: Condition, need_none: bool
    ) -> tuple[Tensor, ...]:
        branches = 3 if need_none else 2
        shown = [images, images, torch.zeros_like(images)][:branches]
        told = [condition.text, condition.null, condition.null][:branches]
        sample = torch.cat((torch.cat([x.to(images)] * branches), torch.cat(shown)), 1)
        text = torch.cat([features.expand(len(x), -1, -1) for features in told])
        dtype = self.unet.dtype
        out = self.unet(sample.to(dtype), t, encoder_hidden_states=text.to(dtype)).sample
        return out.to(x.dtype).chunk(branches)

    @torch.no_grad()
    def _mode(self, images: Tensor) -> Tensor:
        pixels = (2 * images - 1).movedim(-1, 1).to(self.vae.dtype)
        return torch.cat(
            [self.vae.encode(p).latent_dist.mode().float() for p in pixels.split(self.micro_batch)]
        )

    def _embed(self, text: str) -> Tensor:
        tokens = self.tokenizer(
            text,
            padding="max_length",
            max_length=self.tokenizer.model_max_length,
            truncation=True,
            return_tensors="pt",
        )
        return self.text_encoder(tokens.input_ids)[0][0].float()


def load_pix2pix(
    model: str | Path,
    *,
    weights_dir: str | Path | None = None,
    micro_batch: int = 1,
    dtype: torch.dtype = torch.float32,
) -> Pix2Pix:
    """The model of a folder or hub id, looked for on this machine before the hub is asked.

    In order: `model` as a folder, `weights_dir`/`model`, the hub's local cache, the hub. Raises
    UsageError without diffusers, InputError for a model that is missing, incomplete or of another
    kind.
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
    folder = _find(str(model), weights_dir)
    _check_kind(folder)
    schedule, prediction = _schedule(folder)

    def load(part: str, kind: Any, **options: Any) -> Any:
        try:
            return kind.from_pretrained(str(folder / part), local_files_only=True, **options)
        except Exception as error:  # these libraries raise whatever their backends do
            reason = next(iter(str(error).strip().splitlines()), type(error).__name__)
            raise InputError(
                f"{folder / part} cannot be loaded ({reason}): download the model again"
            ) from error

    # low_cpu_mem_usage would need one more package (accelerate)
    options = {"torch_dtype": dtype, "low_cpu_mem_usage": False}
    return Pix2Pix(
        unet=load("unet", UNet2DConditionModel, **options).eval(),
        vae=load("vae", AutoencoderKL, **options).eval(),
        text_encoder=load("text_encoder", transformers.CLIPTextModel).to(dtype).eval(),
        tokenizer=load("tokenizer", transformers.CLIPTokenizer),
        schedule=schedule,
        prediction=prediction,
        micro_batch=micro_batch,
    )


def _find(model: str, weights_dir: str | Path | None) -> Path:
    """The folder that holds the model. Raises InputError."""
    places = [Path(model).expanduser()]
    if weights_dir is not None:
        places += [Path(weights_dir).expanduser() / name for name in (model, Path(model).name)]
    for place in places:
        if place.is_dir():
            return place
    if not re.fullmatch(r"[\w.-]+/[\w.-]+", model):
        raise InputError(f"{model}: no such model folder, and no hub id (like owner/name) either")

    from huggingface_hub import snapshot_download

    for offline in (True, False):
        try:
            options = {"allow_patterns": FILES, "ignore_patterns": SKIPPED}
            folder = Path(snapshot_download(model, local_files_only=offline, **options))
            if offline and not all((folder / part).is_dir() for part in PARTS):
                continue  # an interrupted download: let the hub complete it
            return folder
        except Exception as error:  # network, permission and cache errors have no common base
            reason = type(error).__name__
    raise InputError(
        f"{model} is not on this machine and could not be downloaded ({reason}): "
        f"on a machine with a network run 'hf download {model} --local-dir FOLDER', "
        "then give --model FOLDER"
    )


def _check_kind(folder: Path) -> None:
    """Refuse a folder that is not InstructPix2Pix before gigabytes are read. Raises InputError."""
    missing = [part for part in PARTS if not (folder / part).is_dir()]
    if missing:
        raise InputError(
            f"{folder} has no {' and no '.join(f'{m}/' for m in missing)}: a model folder in "
            f"diffusers' layout has {', '.join(PARTS)}; download it again"
        )
    shown = _config(folder / "unet" / "config.json").get("in_channels")
    latent = _config(folder / "vae" / "config.json").get("latent_channels", 4)
    if shown != 2 * latent:
        raise InputError(
            f"{folder}: this is not an InstructPix2Pix model (its unet takes {shown} channels, "
            f"not {2 * latent}): one of that kind is timbrooks/instruct-pix2pix"
        )


def _schedule(folder: Path) -> tuple[Schedule, str]:
    """(schedule, prediction type) of the folder's scheduler; Stable Diffusion's if it has none."""
    path = folder / "scheduler" / "scheduler_config.json"
    config = _config(path) if path.exists() else {}
    start, end = config.get("beta_start", 0.00085), config.get("beta_end", 0.012)
    steps, kind = config.get("num_train_timesteps", 1000), config.get("beta_schedule")
    prediction = config.get("prediction_type", "epsilon")
    if prediction not in ("epsilon", "v_prediction"):
        raise InputError(f"{path}: prediction_type {prediction!r} is not epsilon or v_prediction")
    if config.get("trained_betas") is not None or config.get("rescale_betas_zero_snr"):
        raise InputError(f"{path}: trained or rescaled betas are not supported, only a formula")
    if config.get("set_alpha_to_one"):
        raise InputError(f"{path}: set_alpha_to_one must be false, as in Stable Diffusion")
    if kind in (None, "scaled_linear"):
        schedule = Schedule.scaled_linear(start, end, steps)
    elif kind == "linear":
        betas = torch.linspace(start, end, steps, dtype=torch.float64)
        schedule = Schedule((1 - betas).cumprod(0))
    else:
        raise InputError(f"{path}: beta_schedule {kind!r} is not scaled_linear or linear")
    return replace(schedule, offset=config.get("steps_offset", 1)), prediction


def _config(path: Path) -> dict[str, Any]:
    try:
        config = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"{path} cannot be read ({error}): download the model again") from error
    if not isinstance(config, dict):
        raise InputError(f"{path} holds no settings: download the model again")
    return config
