"""InstructPix2Pix from a folder in diffusers' layout. The only file that imports diffusers and
transformers."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import torch

from gsedit.diffusion import Prediction, Schedule
from gsedit.editors.pix2pix.denoiser import Pix2Pix, TextEncoder
from gsedit.editors.pix2pix.hub import find
from gsedit.editors.pix2pix.weights import Weights, config_of, inspect
from gsedit.errors import InputError, UsageError

PREDICTIONS: dict[str, Prediction] = {"epsilon": "eps", "v_prediction": "v"}
"""By their names in diffusers' configs."""


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
    parts = _Parts(inspect(find(str(model), weights_dir)).require(), dtype)
    schedule, predicts = _schedule(parts.folder)
    text_encoders = [parts.text_encoder("text_encoder", transformers.CLIPTextModel)]
    if parts.weights.kind == "SDXL":
        kind = transformers.CLIPTextModelWithProjection
        text_encoders.append(parts.text_encoder("text_encoder_2", kind))
    vae = parts.network("vae", AutoencoderKL)
    if getattr(vae.config, "latents_mean", None) is not None:
        raise InputError(
            f"{parts.folder / 'vae'}: latents with a mean (latents_mean) are not supported"
        )
    return Pix2Pix(
        unet=parts.network("unet", UNet2DConditionModel),
        vae=vae,
        text_encoders=tuple(text_encoders),
        schedule=schedule,
        predicts=predicts,
        micro_batch=micro_batch,
        zeros_for_empty=_pipeline(parts.folder).get("force_zeros_for_empty_prompt", True),
    )


@dataclass(frozen=True)
class _Parts:
    """A model's folder, whose parts are loaded one at a time. All raise InputError."""

    weights: Weights
    dtype: torch.dtype

    @property
    def folder(self) -> Path:
        return self.weights.folder

    def network(self, part: str, kind: Any) -> Any:
        """A UNet or VAE of diffusers."""
        # low_cpu_mem_usage would need one more package (accelerate)
        return self._weighted(part, kind, torch_dtype=self.dtype, low_cpu_mem_usage=False)

    def text_encoder(self, part: str, kind: Any) -> TextEncoder:
        """A text encoder of transformers, with its tokenizer."""
        from transformers import CLIPTokenizer

        tokenizer = self._load(part.replace("text_encoder", "tokenizer"), CLIPTokenizer)
        return TextEncoder(self._weighted(part, kind).to(self.dtype), tokenizer)

    def _weighted(self, part: str, kind: Any, **options: Any) -> Any:
        variant = self.weights.variant(part)
        network = self._load(part, kind, use_safetensors=True, variant=variant, **options)
        return network.eval().requires_grad_(False)  # score distillation needs no other gradients

    def _load(self, part: str, kind: Any, **options: Any) -> Any:
        path = self.folder / part
        try:
            return kind.from_pretrained(str(path), local_files_only=True, **options)
        except Exception as error:  # these libraries raise whatever their backends do
            reason = next(iter(str(error).strip().splitlines()), type(error).__name__)
            raise InputError(
                f"{path} cannot be loaded ({reason}): download the model again"
            ) from error


def _pipeline(folder: Path) -> dict[str, Any]:
    """The settings of the whole pipeline; none where the folder has no such file."""
    path = folder / "model_index.json"
    return config_of(path) if path.exists() else {}


def _schedule(folder: Path) -> tuple[Schedule, Prediction]:
    """(schedule, what is predicted) of the folder's scheduler; Stable Diffusion's without one."""
    path = folder / "scheduler" / "scheduler_config.json"
    config = config_of(path) if path.exists() else {}
    start, end = config.get("beta_start", 0.00085), config.get("beta_end", 0.012)
    steps, kind = config.get("num_train_timesteps", 1000), config.get("beta_schedule")
    name = config.get("prediction_type", "epsilon")
    if name not in PREDICTIONS:
        names = " or ".join(PREDICTIONS)
        raise InputError(f"{path}: prediction_type {name!r} is not {names}")
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
    return replace(schedule, offset=config.get("steps_offset", 1)), PREDICTIONS[name]
