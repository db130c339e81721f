"""InstructPix2Pix (Brooks et al. 2023) of Stable Diffusion 1.5 and of SDXL, and CosXL-Edit.

Stable Diffusion has one text encoder; SDXL has two, a pooled feature and the picture's size.
`v` views, `b` views at once, `l d` text tokens and features, `p` pooled features.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor

from gsedit.diffusion.guidance import Need
from gsedit.diffusion.predictions import Prediction
from gsedit.diffusion.schedules import Schedule
from gsedit.editors.models.autoencoder import decoded, encoded
from gsedit.editors.models.hub import find
from gsedit.editors.models.model import Model
from gsedit.editors.models.weights import Weights, config_of, inspect
from gsedit.errors import InputError, UsageError


class TextFeatures(NamedTuple):
    """An instruction as the UNet reads it."""

    tokens: Float[Tensor, "l d"]
    pooled: Float[Tensor, " p"] | None = None
    """Pooled vector of the second text encoder (SDXL)."""


class Condition(NamedTuple):
    """The UNet's input that no step changes."""

    images: Float[Tensor, "v c y x"]
    """Latents of the unedited pictures: the posterior's mode; scaled for CosXL-Edit alone."""
    text: TextFeatures
    null: TextFeatures
    """Features of the empty instruction."""
    size: tuple[int, int]
    """(height, width) of the pictures in pixels: an input of SDXL."""


@dataclass(frozen=True, eq=False)
class TextEncoder:
    """A text encoder with its tokenizer."""

    network: Any
    tokenizer: Any

    def ids(self, text: str) -> Int[Tensor, "1 l"]:
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
        tokens = len(self.tokenizer(text, truncation=False).input_ids)
        return max(0, tokens - self.tokenizer.model_max_length)


@dataclass(frozen=True, eq=False, kw_only=True)
class Pix2Pix(Model):
    """InstructPix2Pix: a UNet that sees the unedited picture beside the noised one."""

    unet: Any
    vae: Any
    text_encoders: tuple[TextEncoder, ...]
    """One of Stable Diffusion, two of SDXL."""
    predicts: Prediction = "eps"
    zeros_for_empty: bool = True
    """SDXL: the features of the empty instruction are zeros, not the encoders' output."""
    scaled_images: bool = False
    """CosXL-Edit: the unedited pictures' latents are scaled too."""

    @property
    def size(self) -> int | None:
        side = self.unet.config.sample_size  # in latent cells; older files have none
        return side * self.cell if isinstance(side, int) else None

    @property
    def cell(self) -> int:
        """Pixels per latent cell: the VAE halves the sides between its blocks."""
        return 2 ** (len(self.vae.config.block_out_channels) - 1)

    @property
    def multiple(self) -> int:
        """Pixels: sides that the VAE and then the UNet can halve at every level, no remainder left.

        A UNet that halves an odd side meets its own skip connections only after stretching them,
        which shifts features by parts of a cell.
        """
        return self.cell * 2 ** (len(self.unet.config.block_out_channels) - 1)

    @property
    def channels(self) -> int:
        return self.vae.config.latent_channels

    def excess(self, prompt: str) -> int:
        return max(encoder.excess(prompt) for encoder in self.text_encoders)

    def encode(self, images: Float[Tensor, "v h w 3"]) -> Float[Tensor, "v c y x"]:
        """The posterior's mode times the VAE's scaling factor, float32; differentiable."""
        return self._mode(images) * self.vae.config.scaling_factor

    @torch.no_grad()
    def decode(self, latents: Float[Tensor, "v c y x"]) -> Float[Tensor, "v h w 3"]:
        """The VAE's decoder, float32."""
        latents = latents / self.vae.config.scaling_factor
        return decoded(self.run, self.vae, latents, self.micro_batch)

    @torch.no_grad()
    def condition(
        self, originals: Float[Tensor, "v h w 3"], prompt: str, generator: torch.Generator
    ) -> Condition:
        """Nothing is drawn: `generator` is not used."""
        text, null = self._embed(prompt), self._embed("")
        if text.pooled is not None and self.zeros_for_empty:
            null = TextFeatures(torch.zeros_like(text.tokens), torch.zeros_like(text.pooled))
        images = self.encode(originals) if self.scaled_images else self._mode(originals)
        height, width = originals.shape[1:3]
        return Condition(images, text, null, (height, width))

    def of_views(self, condition: Condition, views: slice) -> Condition:
        return condition._replace(images=condition.images[views])

    def predict(
        self, x: Float[Tensor, "b c y x"], t: float, condition: Condition, need: Need
    ) -> tuple[Float[Tensor, "b c y x"], ...]:
        """One UNet pass for (text, image), (null, image), (null, zeros), as far as in need."""
        text, null, images = condition.text, condition.null, condition.images
        branches = [(text, images), (null, images), (null, torch.zeros_like(images))]
        texts, shown = zip(*(branch for branch, needed in zip(branches, need) if needed))
        dtype = self.unet.dtype
        sample = torch.cat((torch.cat([x.to(images)] * len(texts)), torch.cat(shown)), 1).to(dtype)
        tokens = torch.cat([each.tokens.expand(len(x), -1, -1) for each in texts]).to(dtype)
        added = self._added(texts, len(x), condition.size)
        time = torch.full((len(sample),), t, dtype=torch.float32)
        out = self.run(_predicted, self.unet, sample, time, tokens, *added)
        return out.to(x.dtype).chunk(len(texts))

    def _added(
        self, texts: Sequence[TextFeatures], views: int, size: tuple[int, int]
    ) -> tuple[Tensor, ...]:
        """SDXL's other inputs: pooled text; size before scaling, crop corner, size wanted."""
        pooled = [each.pooled.expand(views, -1) for each in texts if each.pooled is not None]
        if not pooled:
            return ()
        ids = torch.tensor([*size, 0, 0, *size], dtype=self.unet.dtype)
        text = torch.cat(pooled).to(self.unet.dtype)
        return text, ids.repeat(len(text), 1)

    def _mode(self, images: Float[Tensor, "v h w 3"]) -> Float[Tensor, "v c y x"]:
        return encoded(self.run, self.vae, images, self.micro_batch)

    def _embed(self, text: str) -> TextFeatures:
        if len(self.text_encoders) == 1:
            encoder = self.text_encoders[0]
            return TextFeatures(encoder.network(encoder.ids(text))[0][0].float())
        outputs = [e.network(e.ids(text), output_hidden_states=True) for e in self.text_encoders]
        # the last but one layer of both, and the projection of the second: Podell et al. 2023
        tokens = torch.cat([each.hidden_states[-2][0].float() for each in outputs], -1)
        return TextFeatures(tokens, outputs[-1].text_embeds[0].float())


def _predicted(unet: Any, sample: Tensor, time: Tensor, tokens: Tensor, *added: Tensor) -> Tensor:
    kwargs = dict(zip(("text_embeds", "time_ids"), added)) or None
    return unet(sample, time, encoder_hidden_states=tokens, added_cond_kwargs=kwargs).sample


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
