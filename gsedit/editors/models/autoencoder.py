"""The variational autoencoders of diffusers as functions of tensors.

`v` views of `h w` pixels, `c y x` latents before any scaling.
"""

from __future__ import annotations

from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.editors.models.runtime import Runtime


def encoded(
    run: Runtime, vae: Any, images: Float[Tensor, "v h w 3"], at_once: int
) -> Float[Tensor, "v c y x"]:
    """The mode of the posterior, not scaled, float32; `at_once` views in a pass. Differentiable."""
    pixels = (2 * images - 1).movedim(-1, 1).to(vae.dtype)
    return torch.cat([run(_mode, vae, part).float() for part in pixels.split(at_once)])


def decoded(
    run: Runtime, vae: Any, latents: Float[Tensor, "v c y x"], at_once: int
) -> Float[Tensor, "v h w 3"]:
    """Pictures of latents as the decoder takes them, float32, not clamped."""
    parts = latents.to(vae.dtype).split(at_once)
    images = torch.cat([run(_picture, vae, part).float() for part in parts])
    return images.movedim(1, -1) / 2 + 0.5


def _mode(vae: Any, pixels: Tensor) -> Tensor:
    encoding = vae.encode(pixels)
    # AutoencoderTiny (TAESD's architecture) has no distribution
    return encoding.latents if "latents" in encoding else encoding.latent_dist.mode()


def _picture(vae: Any, latents: Tensor) -> Tensor:
    return vae.decode(latents).sample
