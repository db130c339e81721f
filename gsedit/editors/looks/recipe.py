"""Recipes of looks: those that an instruction names, applied to pictures in closed form."""

from __future__ import annotations

import re
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.editors.looks.color_maps import Image
from gsedit.editors.looks.table import LOOKS, VARIANTS
from gsedit.errors import UsageError
from gsedit.words.asked import looks_asked
from gsedit.words.read import denies, read_instruction

NAMES = {word: name for name, look in LOOKS.items() for word in look.words}
PATTERN = re.compile(rf"\b(?:{'|'.join(sorted(NAMES, key=len, reverse=True))})\b")
SIMILAR = {"slate": "stone", "sandstone": "stone", "terracotta": "clay"}
"""Looks of gsedit.words that have another name here."""
STATUE = re.compile(r"\b(?:statue|sculpture|petrified)\b")  # stone, unless a look is named


@dataclass(frozen=True)
class Recipe:
    """Looks applied one after the other: what an instruction means."""

    names: tuple[str, ...]

    def variant(self, images: Image, k: int) -> Image:
        """The k-th variant of every look in turn, in [0, 1]."""
        for name in self.names:
            images = LOOKS[name].variants[k](images).clamp(0, 1)
        return images

    def variants(self, images: Float[Tensor, "v h w 3"]) -> Float[Tensor, "k v h w 3"]:
        """All variants, in [0, 1]."""
        return torch.stack([self.variant(images, k) for k in range(VARIANTS)])


def parse(prompt: str) -> Recipe:
    """The looks that an instruction names, in the order of its words; if none, those that it is
    understood as (gsedit.words), the subject's first.

    Raises UsageError for an instruction that is empty or asks for none of them.
    """
    text = " ".join(re.findall(r"[a-z]+", prompt.lower()))
    if not text:
        raise UsageError('the instruction is empty: say what to change, e.g. "make it snow"')
    read = read_instruction(prompt)
    if read.refusal == "negation":
        raise UsageError(f"{prompt.strip()!r}: {read.why}")
    if read.known and denies(prompt):
        text = " ".join(change.name for change in read.changes)
    names = [NAMES[match.group()] for match in PATTERN.finditer(text)]
    if not names and STATUE.search(text):
        names = ["stone"]
    names = names or _understood(prompt)
    if not names:
        raise UsageError(
            f"the closed-form editor does not know {prompt.strip()!r}; it knows "
            f"{', '.join(LOOKS)}. For any instruction: --editor pix2pix --model FOLDER "
            "(InstructPix2Pix weights)"
        )
    return Recipe(tuple(dict.fromkeys(names)))


def _understood(prompt: str) -> list[str]:
    """The looks that a sentence asks for; none where one of them is not among those here."""
    try:
        asked = looks_asked(prompt)
    except UsageError:
        return []
    names = [SIMILAR.get(look.name, look.name) for look in asked]
    return names if LOOKS.keys() >= set(names) else []


def agreed_variant(
    recipe: Recipe, edited: Float[Tensor, "v h w 3"], originals: Float[Tensor, "v h w 3"]
) -> tuple[int, tuple[int, ...]]:
    """The variant that most views show, and each view's own (nearest in squared error).

    A tie goes to the lower index.
    """
    errors = (recipe.variants(originals) - edited).square().mean((-3, -2, -1))
    votes = tuple(int(k) for k in errors.argmin(0))
    return max(range(VARIANTS), key=votes.count), votes
