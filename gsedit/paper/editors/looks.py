"""Looks of the closed-form editor, each in three variants, and those that a sentence names.

A look maps each pixel by its own color alone, so one surface point gets one edited color in every
view. `h w` pixels, sRGB in [0, 1]; any leading axes. Colors are given as hexadecimal codes
separated by blanks, from dark to bright.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.change.light.relight import step
from gsedit.errors import UsageError
from gsedit.scene.color_space import srgb_of_hex
from gsedit.words.read import read_instruction

VARIANTS = 3
Image = Float[Tensor, "*v h w 3"]
Grey = Float[Tensor, "*v h w 1"]
Values = Float[Tensor, "*d"]
ColorMap = Callable[[Image], Image]

LUMA = (0.299, 0.587, 0.114)  # Rec. 601: weights of gamma-coded R, G, B


def luma(images: Image) -> Grey:
    """Brightness of gamma-coded colors (Rec. 601)."""
    return (images * images.new_tensor(LUMA)).sum(-1, keepdim=True)


def colors(codes: str) -> list[list[float]]:
    """Hexadecimal codes, separated by blanks, as (red, green, blue) in [0, 1]."""
    return [srgb_of_hex(code).tolist() for code in codes.split()]


def gradient_map(brightness: Grey, codes: str) -> Image:
    """Colors evenly spaced over brightness 0 to 1, linear in between."""
    stops = brightness.new_tensor(colors(codes))
    position = brightness.clamp(0, 1) * (len(stops) - 1)
    # a sum of hinges: unlike a table look-up it keeps gradients, and the leading axes
    slopes = stops.diff(dim=0)
    slope_changes = torch.cat((slopes[:1], slopes.diff(dim=0)))
    hinges = (position - torch.arange(len(slope_changes)).to(position)).clamp_min(0)
    return stops[0] + hinges @ slope_changes


def s_curve(x: Values, amount: float) -> Values:
    """An S-curve about 0.45, where outdoor photos have their middle; 0 changes nothing."""
    return x + amount * (step(x, 0.0, 0.9) - x)


def ramp(codes: str, *, keep: float = 0.1, contrast: float = 0.6, gamma: float = 1.5) -> ColorMap:
    """Brightness becomes a color; `keep` of the original's color differences stays."""

    def apply(images: Image) -> Image:
        grey = luma(images)
        toned = gradient_map(s_curve(grey, contrast).clamp(0, 1) ** gamma, codes)
        return toned + keep * (images - grey)

    return apply


def snow(shade: str, bright: str, *, depth: float) -> ColorMap:
    """Bright, dull pixels are covered; dark or colorful ones still show through."""

    def apply(images: Image) -> Image:
        grey = luma(images)
        chroma = images.amax(-1, keepdim=True) - images.amin(-1, keepdim=True)
        cover = step(grey - 0.25 * chroma, 0.55 - depth, 0.85 - depth)
        bare = gradient_map(s_curve(grey, 0.5), f"0a0f18 {shade} {bright}") + 0.25 * (images - grey)
        fallen = images.new_tensor(colors(bright)[0]) * (0.5 + 0.5 * step(grey, 0.0, 1.0))
        return bare + cover * (fallen - bare)

    return apply


def foliage(leaf: str, tint: str) -> ColorMap:
    """Greens turn to a leaf color of their own brightness; the rest is warmed."""

    def apply(images: Image) -> Image:
        red, green, blue = images.split(1, -1)
        grey = luma(images)
        leafy = step(green - 0.5 * (red + blue), 0.0, 0.08)
        turned = gradient_map(s_curve(grey * 1.25, 0.5), f"140603 {leaf}")
        warmed = grey + 1.15 * (images - grey)
        warmed = s_curve(warmed, 0.3) * images.new_tensor(colors(tint)[0])
        return warmed + leafy * (turned - warmed)

    return apply


def veined(codes: str, vein: str) -> ColorMap:
    """A ramp with thin veins along lines of equal brightness, so they stay on the surface."""
    base = ramp(codes, keep=0.04, contrast=0.35)

    def apply(images: Image) -> Image:
        phase = 6.0 * luma(images) + 1.5 * (images[..., :1] - images[..., 2:])
        line = (-((torch.sin(torch.pi * phase) / 0.12) ** 2)).exp()
        image = base(images)
        return image + 0.15 * line * (images.new_tensor(colors(vein)[0]) - image)

    return apply


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
    "autumn": Look(
        ("autumn", "autumnal", "fall foliage", "october"),
        (
            foliage("8c3c08 e88c1c ffd870", "ffecd0"),  # amber
            foliage("64100c c4301c f89060", "ffd8cc"),  # crimson
            foliage("847008 e8cc28 fff8a0", "fcf8c8"),  # yellow
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
    names = _named(understood)
    if not read.known:
        names = names or _named(text) or ["stone"] * bool(STATUE.search(text))
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
