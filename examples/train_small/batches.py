"""What one step of training sees: pictures, sentences, and what the sentences make of them.

`n` pictures of `h w` pixels, `b` lessons.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from train_small.phrases import garbled, held_out_pair, pick, training_prompt
from train_small.sources import Sources, Stored, cat
from train_small.target_edits import TRUTHS, Draw, edited

PAIRED = 0.25
"""The share of lessons that ask for two looks: a subject's and a scene's."""
SUBJECT = 0.55
"""The share of subject looks among the single ones: they are harder, where the subject ends."""
NEAR = 0.5
"""What is nearer, in distances of the subject, is as far as this to the eye: else the ground at the
camera's feet would be most of what it learns."""
SMALLEST = 0.65
"""Of a picture's height: the smallest part that is shown."""
SUBJECT_LOOKS = tuple(name for name, truth in TRUTHS.items() if truth.scope == "subject")
SCENE_LOOKS = tuple(name for name, truth in TRUTHS.items() if truth.scope == "scene")


class Lessons(NamedTuple):
    """Pictures, some instructions for each, and the answers, picture by picture."""

    pictures: Float[Tensor, "n h w 3"]
    prompts: tuple[str, ...]
    answers: Float[Tensor, "b h w 3"]
    geometry: Float[Tensor, "n h w 3"]
    """What there is to see in the pictures: the subject's share, 1 / depth, the normal's height."""


def lessons(
    stored: Stored,
    size: int,
    count: int,
    edits: int,
    generator: torch.Generator,
    strange: float = 0.0,
    borrowed: float = 0.0,
) -> Lessons:
    """Parts of `count` random pictures, `size` pixels square and differently exposed, each with
    `edits` instructions: a random look or two in random words, a share of them `strange` (see
    garbled, and there `borrowed`)."""
    index = torch.randint(len(stored), (count,), generator=generator)
    sources = cat([framed(stored[i], size, generator) for i in index[:, None]])
    sources = sources._replace(image=developed(sources.image, generator))
    if bool(torch.rand((), generator=generator) < 0.5):
        sources = mirrored(sources)
    names = [random_looks(generator) for _ in range(count * edits)]
    answers = [
        edited(sources.rows(torch.tensor([i // edits])), each, Draw.random(generator))
        for i, each in enumerate(names)
    ]
    prompts = [training_prompt(each, generator) for each in names]
    if strange:
        drawn = torch.rand(len(prompts), generator=generator) < strange
        prompts = [
            garbled(prompt, generator, borrowed) if odd else prompt
            for prompt, odd in zip(prompts, drawn.tolist())
        ]
    geometry = (sources.subject, 1 / sources.depth.clamp_min(NEAR), sources.normal[..., 2:])
    return Lessons(sources.image, tuple(prompts), torch.cat(answers), torch.cat(geometry, -1))


def random_looks(generator: torch.Generator) -> tuple[str, ...]:
    """One look, or a subject's with a scene's of the pairs that are not held out."""
    kind = float(torch.rand((), generator=generator))
    if kind >= PAIRED:
        share = (kind - PAIRED) / (1 - PAIRED)
        return (pick(SUBJECT_LOOKS if share < SUBJECT else SCENE_LOOKS, generator),)
    while True:
        pair = pick(SUBJECT_LOOKS, generator), pick(SCENE_LOOKS, generator)
        if not held_out_pair(*pair):
            return pair


def framed(sources: Sources, size: int, generator: torch.Generator) -> Sources:
    """A random square of the picture, from SMALLEST of its height to all of it, at that size."""
    height, width = sources.image.shape[1:3]
    share = SMALLEST + (1 - SMALLEST) * float(torch.rand((), generator=generator))
    side = round(share * min(height, width))
    top = int(torch.randint(height - side + 1, (), generator=generator))
    left = int(torch.randint(width - side + 1, (), generator=generator))
    part = (..., slice(top, top + side), slice(left, left + side))
    return sources.mapped(
        lambda planes: F.interpolate(planes[part], (size, size), mode="bilinear", antialias=True)
    )


def developed(
    images: Float[Tensor, "b h w 3"], generator: torch.Generator
) -> Float[Tensor, "b h w 3"]:
    """As another camera would have taken them: exposure, white balance, contrast, colour, grain."""

    def draw(deviation: float, channels: int = 1) -> Tensor:
        shape = (len(images), 1, 1, channels)
        return deviation * torch.randn(shape, generator=generator)

    gamma, gain = draw(0.15).exp(), (draw(0.08) + draw(0.04, 3)).exp()
    image = images.clamp(1e-4, 1) ** gamma * gain
    grey = image.mean(-1, keepdim=True)
    image = grey + draw(0.2).exp() * (image - grey)
    grain = torch.randn(images.shape, generator=generator) * draw(0.015).abs()
    return (image + grain).clamp(0, 1)


def mirrored(sources: Sources) -> Sources:
    """Left and right exchanged; of normals the height is kept, and no look asks for more."""
    return Sources(*(field.flip(2) for field in sources))
