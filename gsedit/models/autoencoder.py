"""The variational autoencoders of diffusers as functions of tensors.

`v` views of `h w` pixels, `c y x` latents before any scaling.
"""

from __future__ import annotations

import hashlib
from collections import OrderedDict
from typing import Any
from weakref import WeakKeyDictionary

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.models.runtime import Runtime

MOST_REMEMBERED = 256
"""Pictures whose latents are kept: of 512 pixels, they take 20 MB."""
_known: WeakKeyDictionary[Any, OrderedDict[bytes, Tensor]] = WeakKeyDictionary()


def mode_of(vae: Any, pixels: Tensor) -> Tensor:
    """The posterior's mode of pixels in [-1, 1]."""
    encoding = vae.encode(pixels)
    # AutoencoderTiny (TAESD's architecture) has no distribution
    return encoding.latents if "latents" in encoding else encoding.latent_dist.mode()


def picture_of(vae: Any, latents: Tensor) -> Tensor:
    """Pixels in about [-1, 1] of latents."""
    return vae.decode(latents).sample


def encoded(
    run: Runtime, vae: Any, images: Float[Tensor, "v h w 3"], at_once: int
) -> Float[Tensor, "v c y x"]:
    """The mode of the posterior, not scaled, float32; `at_once` views in a pass. Differentiable.

    A picture without gradients is encoded once: each batch of an edit brings finished views again.
    """
    pixels = (2 * images - 1).movedim(-1, 1).to(vae.dtype)
    if images.requires_grad and torch.is_grad_enabled():
        return torch.cat([run(mode_of, vae, part).float() for part in pixels.split(at_once)])
    known = _known.setdefault(vae, OrderedDict())
    keys = [_key(each) for each in images]
    new = {key: i for i, key in enumerate(keys) if key not in known}
    if new:
        parts = pixels[list(new.values())].split(at_once)
        known |= zip(new, torch.cat([run(mode_of, vae, part).float() for part in parts]).unbind())
    latents = torch.stack([known[key] for key in keys])
    while len(known) > MOST_REMEMBERED:
        known.popitem(last=False)
    return latents


def _key(image: Float[Tensor, "h w 3"]) -> bytes:
    """A picture's identity: its size and numbers, and the precision that is asked for."""
    rounded = torch.is_autocast_enabled("cpu")
    named = f"{tuple(image.shape)} {image.dtype} {rounded}".encode()
    numbers = image.detach().contiguous().view(-1).view(torch.uint8).numpy()
    return hashlib.blake2b(numbers.data, digest_size=16, salt=b"", key=named[:64]).digest()


def decoded(
    run: Runtime,
    vae: Any,
    latents: Float[Tensor, "v c y x"],
    at_once: int,
) -> Float[Tensor, "v h w 3"]:
    """Pictures of latents as the decoder takes them, float32, not clamped."""
    parts = latents.to(vae.dtype).split(at_once)
    images = torch.cat([run(picture_of, vae, part).float() for part in parts])
    return images.movedim(1, -1) / 2 + 0.5
