"""Looks of the closed-form editor, each in three variants, and those that a sentence names."""

from __future__ import annotations

import re
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.errors import UsageError
from gsedit.paper.editors.looks.color_maps import (
    ColorMap,
    Image,
    foliage,
    ramp,
    sketch,
    snow,
    veined,
    watercolor,
)
from gsedit.words.read import denies, read_instruction

VARIANTS = 3


@dataclass(frozen=True)
class Look:
    """Words that ask for a look, and its variants."""

    words: tuple[str, ...]
    """Lower case; a word may be a phrase. Their order is of no meaning."""
    variants: tuple[ColorMap, ColorMap, ColorMap]


LOOKS: dict[str, Look] = {
    "bronze": Look(
        ("bronze", "brass", "bronzed"),
        (
            ramp("140a04 5a3414 b07a2c f0c878 fff4d0"),  # polished, golden brown
            ramp("080504 2a1810 5c3a26 9c6c4a e8c8a4"),  # dark
            ramp("06120f 1c4a40 4c9484 96ccb4 ecf4dc", keep=0.15),  # green patina
        ),
    ),
    "gold": Look(
        ("gold", "golden", "gilded"),
        (
            ramp("2a1600 8a5400 e0a010 ffdc50 fffbd8"),  # yellow gold
            ramp("2a0e0a 8c4438 d88c78 f8c8b4 fff4ec"),  # rose gold
            ramp("161206 4c4414 8c8030 c8c070 f8f4cc"),  # old green gold
        ),
    ),
    "marble": Look(
        ("marble", "porcelain", "alabaster"),
        (
            veined("5c5c62 b4b4b8 e4e2de fbfaf6 ffffff", "54565e"),  # Carrara
            veined("060608 1c1c20 3c3c42 6c6a70 d0ccc8", "e8dcc0"),  # black, gold veins
            veined("4c2c28 a87068 dca89c f4d8cc fff6f0", "8c3c38"),  # rose
        ),
    ),
    "stone": Look(
        ("stone", "granite", "rock", "concrete", "limestone", "sandstone", "slate"),
        (
            ramp("18181a 4c4c4c 808080 acaca8 dcdcd4", keep=0.03, contrast=0.4),  # granite
            ramp("38281a 806448 c0a078 e4d0a8 f8f0d8", keep=0.06, contrast=0.4),  # sandstone
            ramp("0c1014 28343c 485864 78888c b8c4c4", keep=0.03, contrast=0.4),  # slate
        ),
    ),
    "snow": Look(
        ("snow", "snowy", "snowing", "snowfall", "snowed", "winter", "wintry", "blizzard"),
        (
            snow("6c7c90", "f8fbff", depth=0.22),  # a clear morning
            snow("3c5878", "b4d0f4", depth=0.22),  # blue shade
            snow("8c5c68", "ffd8c0", depth=0.26),  # evening light
        ),
    ),
    "night": Look(
        ("night", "nighttime", "midnight", "moonlight", "moonlit"),
        (
            ramp("01030c 0a1838 24447c 6890c8 d8ecff", keep=0.15, contrast=0.7, gamma=1.9),
            ramp("02080a 06282c 145c5c 48a498 d0fff0", keep=0.15, contrast=0.7, gamma=1.9),
            ramp("08020e 240c3c 54287c 9c68c0 f4dcff", keep=0.15, contrast=0.7, gamma=1.9),
        ),
    ),
    "autumn": Look(
        ("autumn", "autumnal", "fall foliage", "october"),
        (
            foliage("8c3c08 e88c1c ffd870", "ffecd0"),  # amber
            foliage("64100c c4301c f89060", "ffd8cc"),  # crimson
            foliage("847008 e8cc28 fff8a0", "fcf8c8"),  # yellow
        ),
    ),
    "sepia": Look(
        ("sepia", "vintage", "old photo", "old photograph"),
        (
            ramp("1c1008 644830 ac8c64 e0c8a0 fff4dc", keep=0.0, contrast=0.4),
            ramp("0c0a0c 3c2c2c 745858 b49490 ecd4c8", keep=0.0, contrast=0.4),
            ramp("302810 88784c c8bc88 ece4bc fffce8", keep=0.0, contrast=0.2, gamma=0.8),
        ),
    ),
    "sketch": Look(
        ("sketch", "sketched", "pencil", "drawing", "charcoal"),
        (
            sketch("1c1c20", "fcfcf8"),  # graphite
            sketch("0c2468", "e4ecf8"),  # blue ink
            sketch("6c1c0c", "f4dcc0"),  # red chalk
        ),
    ),
    "black-and-white": Look(
        ("black and white", "monochrome", "grayscale", "greyscale", "noir", "b w"),
        (
            ramp("000000 404040 808080 c0c0c0 ffffff", keep=0.0, contrast=0.8),
            ramp("000000 141414 343434 6c6c6c f0f0f0", keep=0.0, contrast=0.9),  # low key
            ramp("303030 8c8c8c c8c8c8 ececec ffffff", keep=0.0, contrast=0.4),  # high key
        ),
    ),
    "jade": Look(
        ("jade", "emerald", "malachite"),
        (
            ramp("041c10 14603c 48ac74 a0dcac f0fff0", keep=0.05),  # green
            ramp("020c08 083424 145c40 34906c a0d8bc", keep=0.05),  # dark
            ramp("34401c 88985c c4d098 e8f0cc fffff4", keep=0.05),  # pale
        ),
    ),
    "watercolor": Look(
        ("watercolor", "watercolour", "aquarelle", "watercolors", "painting"),
        (
            watercolor("fff4e0", 1.9),  # warm paper
            watercolor("c8e0ff", 1.6),  # cool wash
            watercolor("ffccd0", 1.6),  # rose wash
        ),
    ),
    "sunset": Look(
        ("sunset", "sunrise", "dusk", "golden hour", "dawn", "evening"),
        (
            ramp("180c20 64283c d06440 ffb45c fff4c0", keep=0.5),  # orange
            ramp("100c2c 50286c b44c88 f89090 ffe4c0", keep=0.5),  # purple
            ramp("201408 70440c d89c28 ffdc70 fffce0", keep=0.5),  # gold
        ),
    ),
}
"""By name, in the order in which they are listed. Variants differ at a glance."""

NAMES = {word: name for name, look in LOOKS.items() for word in look.words}
PATTERN = re.compile(rf"\b(?:{'|'.join(sorted(NAMES, key=len, reverse=True))})\b")
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
    """The looks that an instruction names, in the order of its words; if none, those of the changes
    that are read in it (gsedit.words).

    Raises UsageError for an instruction that is empty or asks for none of them.
    """
    text = " ".join(re.findall(r"[a-z]+", prompt.lower()))
    if not text:
        raise UsageError('the instruction is empty: say what to change, e.g. "make it snow"')
    read = read_instruction(prompt)
    if read.refusal == "negation":
        raise UsageError(f"{prompt.strip()!r}: {read.why}")
    understood = " ".join(change.name for change in read.changes)
    if read.known and denies(prompt):
        text = understood
    names = _named(text) or ["stone"] * bool(STATUE.search(text)) or _named(understood)
    if not names:
        raise UsageError(
            f"the closed-form editor does not know {prompt.strip()!r}; it knows "
            f"{', '.join(LOOKS)}. For any instruction: --editor pix2pix --model FOLDER "
            "(InstructPix2Pix weights)"
        )
    return Recipe(tuple(dict.fromkeys(names)))


def _named(text: str) -> list[str]:
    return [NAMES[match.group()] for match in PATTERN.finditer(text)]


def agreed_variant(
    recipe: Recipe, edited: Float[Tensor, "v h w 3"], originals: Float[Tensor, "v h w 3"]
) -> tuple[int, tuple[int, ...]]:
    """The variant that most views show, and each view's own (nearest in squared error).

    A tie goes to the lower index.
    """
    errors = (recipe.variants(originals) - edited).square().mean((-3, -2, -1))
    votes = tuple(int(k) for k in errors.argmin(0))
    return max(range(VARIANTS), key=votes.count), votes
