"""Batches of training: crops of pictures, prompts, and what the prompts make of the crops.

`n` pictures of `h w` pixels; `b` prompts, some for each picture.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from research.train_small.prompts import augmented, held_out_pair, pick, training_prompt
from research.train_small.sources import PackedSources, Sources, cat
from research.train_small.target_edits import TARGET_EDITS, Variation, target_images

PAIR_SHARE = 0.25
"""Share of the prompts that ask for two looks: a subject's and a scene's."""
SUBJECT_SHARE = 0.55
"""Share of subject looks among the others: they are harder, at the subject's edge."""
NEAREST = 0.5
"""In distances of the subject: nearer depths count as this one, else the ground at the camera's
feet would dominate the geometry loss."""
SMALLEST_CROP = 0.65
"""Share of a picture's height."""
SUBJECT_LOOKS = tuple(name for name, edit in TARGET_EDITS.items() if edit.scope == "subject")
SCENE_LOOKS = tuple(name for name, edit in TARGET_EDITS.items() if edit.scope == "scene")


class TrainingBatch(NamedTuple):
    """Pictures, some prompts for each, and their target images, picture by picture."""

    images: Float[Tensor, "n h w 3"]
    """Unedited, sRGB in [0, 1]."""
    prompts: tuple[str, ...]
    targets: Float[Tensor, "b h w 3"]
    geometry: Float[Tensor, "n h w 3"]
    """Targets of the image encoder: the subject's share, 1 / depth, the normal's height."""


def training_batch(
    pictures: PackedSources,
    size: int,
    count: int,
    edits: int,
    generator: torch.Generator,
    augmented_prompts: float = 0.0,
    distractors: float = 0.0,
) -> TrainingBatch:
    """Crops of `count` random pictures, scaled to `size` pixels a side, with random colors and
    `edits` prompts each, which ask for one or two random looks. A share `augmented_prompts` of
    the prompts is augmented, with a share `distractors` (see prompts.augmented)."""
    index = torch.randint(len(pictures), (count,), generator=generator)
    sources = cat([random_crop(pictures[i], size, generator) for i in index[:, None]])
    sources = sources._replace(image=color_jitter(sources.image, generator))
    if bool(torch.rand((), generator=generator) < 0.5):
        sources = flipped(sources)
    looks = [random_looks(generator) for _ in range(count * edits)]
    targets = [
        target_images(sources.rows(torch.tensor([i // edits])), names, Variation.random(generator))
        for i, names in enumerate(looks)
    ]
    prompts = [training_prompt(names, generator) for names in looks]
    if augmented_prompts:
        chosen = torch.rand(len(prompts), generator=generator) < augmented_prompts
        prompts = [
            augmented(prompt, generator, distractors) if augment else prompt
            for prompt, augment in zip(prompts, chosen.tolist())
        ]
    inverse_depth = 1 / sources.depth.clamp_min(NEAREST)
    geometry = torch.cat((sources.subject, inverse_depth, sources.normal[..., 2:]), -1)
    return TrainingBatch(sources.image, tuple(prompts), torch.cat(targets), geometry)


def random_looks(generator: torch.Generator) -> tuple[str, ...]:
    """One look, or a subject's with a scene's of the pairs that are not held out."""
    kind = float(torch.rand((), generator=generator))
    if kind >= PAIR_SHARE:
        share = (kind - PAIR_SHARE) / (1 - PAIR_SHARE)
        return (pick(SUBJECT_LOOKS if share < SUBJECT_SHARE else SCENE_LOOKS, generator),)
    while True:
        pair = pick(SUBJECT_LOOKS, generator), pick(SCENE_LOOKS, generator)
        if not held_out_pair(*pair):
            return pair


def random_crop(sources: Sources, size: int, generator: torch.Generator) -> Sources:
    """A random square of the picture, SMALLEST_CROP to 1 of its height, scaled to `size`
    pixels a side."""
    height, width = sources.image.shape[1:3]
    share = SMALLEST_CROP + (1 - SMALLEST_CROP) * float(torch.rand((), generator=generator))
    side = round(share * min(height, width))
    top = int(torch.randint(height - side + 1, (), generator=generator))
    left = int(torch.randint(width - side + 1, (), generator=generator))
    part = (..., slice(top, top + side), slice(left, left + side))
    return sources.resampled(
        lambda planes: F.interpolate(planes[part], (size, size), mode="bilinear", antialias=True)
    )


def color_jitter(
    images: Float[Tensor, "b h w 3"], generator: torch.Generator
) -> Float[Tensor, "b h w 3"]:
    """Random exposure, white balance, contrast, saturation and grain; in [0, 1]."""

    def draw(deviation: float, channels: int = 1) -> Float[Tensor, "b 1 1 c"]:
        shape = (len(images), 1, 1, channels)
        return deviation * torch.randn(shape, generator=generator)

    gamma, gain = draw(0.15).exp(), (draw(0.08) + draw(0.04, 3)).exp()
    image = images.clamp(1e-4, 1) ** gamma * gain
    grey = image.mean(-1, keepdim=True)
    image = grey + draw(0.2).exp() * (image - grey)
    grain = torch.randn(images.shape, generator=generator) * draw(0.015).abs()
    return (image + grain).clamp(0, 1)


def flipped(sources: Sources) -> Sources:
    """Mirrored left to right. Only the height of the normals stays valid; no look uses more."""
    return Sources(*(field.flip(2) for field in sources))
