"""A diffusion model of edited pictures whose score is exact: no weights, a known ground truth.

`v` views, `k` components, `c y x` latents, `d` code channels. In units of a clean latent, a noised
one is q = x_t / sqrt(ab) = x0 + s n with unit noise n and s^2 = (1 - ab) / ab.

A latent is the picture, 8x8 pixels a cell, and in every cell a code: which variant of the edit the
cell shows; 0 for an unedited picture. For a picture z and an instruction with variants m_k:
  text + image   sum_k pi_k N(m_k, w^2): the variants, each as this view's editor would render it
  image alone    (1 - a) N(z, w^2) + a (text + image): the picture as it is; with the text dropped,
                 this edit remains one possibility among all
  neither        (1 - b) N(0, 1) + b (image alone): a prior far broader than the pictures, which
                 gives way to them where the noise is finer than it (b = 2^(-n/2), n dimensions)
Each branch's eps is (q - E[x0 | q]) / s with the posterior mean in closed form.

Guidance. While noise hides the picture the image branch predicts z, and 7.5 / 1.5 exaggerates what
the text adds. Near a variant it predicts m_k too (a consistent marginal must), s_T falls out of the
formula, and sampling ends exactly at m_k for every s_T. (A single broad Gaussian instead, of
precision 1 / s_I^2 << 7.5 / w^2, has the right limit, but there the guided ODE has slope 1 - s_T
in log s: 20 Euler steps of it diverge. A narrow one overshoots to 7.5 m - 6 z.)

Choice. A view's cells choose their variant together, by <q, m_j - m_k> / s^2. Were it read off the
pixels, some 10^5 of them would decide it in the first step, before views can agree, and in favour
of the variant towards which guidance overshoots. So the picture's share of the latent is small
(RADIUS), the noise hides it at first, and the codes decide: equally far from each other and from
the unedited picture, hence equally likely, and of a size (CODE_NORM) at which the decision falls
into the consensus window. Without consensus every view chooses by its own noise.

The variants are of looks that a sentence names. A look maps each pixel by its own color alone, so
one surface point gets one edited color in every view. `h w` pixels, sRGB in [0, 1].
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from gsedit.change.light.relight import step
from gsedit.errors import UsageError
from gsedit.paper.diffusion.guidance import Branches, Need, Prediction
from gsedit.paper.diffusion.schedules import Schedule
from gsedit.paper.editors.protocol import Capabilities, GroundTruth
from gsedit.scene.color_space import srgb_of_hex
from gsedit.views.image_ops import PadMode, rotate_hue
from gsedit.words.read import read_instruction

VARIANTS = 3
Image = Float[Tensor, "*v h w 3"]
LUMA = (0.299, 0.587, 0.114)  # Rec. 601: weights of gamma-coded R, G, B
LOOKS = {
    "bronze": (
        "140a04 5a3414 b07a2c f0c878 fff4d0", "080504 2a1810 5c3a26 9c6c4a e8c8a4",
        "06120f 1c4a40 4c9484 96ccb4 ecf4dc",
    ),
    "gold": (
        "2a1600 8a5400 e0a010 ffdc50 fffbd8", "2a0e0a 8c4438 d88c78 f8c8b4 fff4ec",
        "161206 4c4414 8c8030 c8c070 f8f4cc",
    ),
    "marble": (
        "5c5c62 b4b4b8 e4e2de fbfaf6 ffffff", "060608 1c1c20 3c3c42 6c6a70 d0ccc8",
        "4c2c28 a87068 dca89c f4d8cc fff6f0",
    ),
    "stone": (
        "18181a 4c4c4c 808080 acaca8 dcdcd4", "38281a 806448 c0a078 e4d0a8 f8f0d8",
        "0c1014 28343c 485864 78888c b8c4c4",
    ),
    "snow": (
        "0a0f18 6c7c90 c4d0dc f0f6fc f8fbff", "0a0f18 3c5878 7ca0c8 a8c8ec b4d0f4",
        "0a0f18 8c5c68 d8a090 f8d0b4 ffd8c0",
    ),
    "autumn": (
        "140603 8c3c08 e88c1c ffc050 ffd870", "140603 64100c c4301c e87050 f89060",
        "140603 847008 e8cc28 f8ec70 fff8a0",
    ),
    "jade": (
        "041c10 14603c 48ac74 a0dcac f0fff0", "020c08 083424 145c40 34906c a0d8bc",
        "34401c 88985c c4d098 e8f0cc fffff4",
    ),
}  # fmt: skip
"""Colors of the variants of each look, from dark to bright. Variants differ at a glance."""
KEPT = 0.1
"""Share of the original's color differences that stays."""


def luma(images: Image) -> Float[Tensor, "*v h w 1"]:
    """Brightness of gamma-coded colors (Rec. 601)."""
    return (images * images.new_tensor(LUMA)).sum(-1, keepdim=True)


def ramp(images: Image, codes: str) -> Image:
    """Brightness becomes a color, by an S-curve about 0.45, where outdoor photos have their middle,
    and linear between the evenly spaced `codes`."""
    stops = images.new_tensor([srgb_of_hex(code).tolist() for code in codes.split()])
    gray = luma(images)
    curved = (gray + 0.6 * (step(gray, 0.0, 0.9) - gray)).clamp(0, 1) ** 1.5
    # a sum of hinges: unlike a table look-up it keeps gradients, and the leading axes
    slopes = stops.diff(dim=0)
    changes = torch.cat((slopes[:1], slopes.diff(dim=0)))
    hinges = (curved * len(slopes) - torch.arange(len(slopes)).to(stops)).clamp_min(0)
    return stops[0] + hinges @ changes + KEPT * (images - gray)


@dataclass(frozen=True)
class Recipe:
    """Looks applied one after the other: what an instruction means."""

    names: tuple[str, ...]

    def variant(self, images: Image, k: int) -> Image:
        """The k-th variant of every look in turn, in [0, 1]."""
        for name in self.names:
            images = ramp(images, LOOKS[name][k]).clamp(0, 1)
        return images

    def variants(self, images: Float[Tensor, "v h w 3"]) -> Float[Tensor, "k v h w 3"]:
        """All variants, in [0, 1]."""
        return torch.stack([self.variant(images, k) for k in range(VARIANTS)])


def parse(prompt: str) -> Recipe:
    """The looks that an instruction names, in the order of its words (gsedit.words).

    Raises UsageError for an instruction that is empty or asks for none of them.
    """
    if not prompt.strip():
        raise UsageError('the instruction is empty: say what to change, e.g. "make it snow"')
    read = read_instruction(prompt)
    if read.refusal == "negation":
        raise UsageError(f"{prompt.strip()!r}: {read.why}")
    names = [change.name for change in read.changes if change.name in LOOKS]
    if not names:
        raise UsageError(
            f"the closed-form editor does not know {prompt.strip()!r}; it knows "
            f"{', '.join(LOOKS)}. For any instruction: --editor pix2pix --model FOLDER "
            "(InstructPix2Pix weights)"
        )
    return Recipe(tuple(dict.fromkeys(names)))


def agreed_variant(
    recipe: Recipe, edited: Float[Tensor, "v h w 3"], originals: Float[Tensor, "v h w 3"]
) -> tuple[int, tuple[int, ...]]:
    """The variant that most views show, and each view's own (nearest in squared error).

    A tie goes to the lower index.
    """
    errors = (recipe.variants(originals) - edited).square().mean((-3, -2, -1))
    votes = tuple(int(k) for k in errors.argmin(0))
    return max(range(VARIANTS), key=votes.count), votes


CODE = 2  # channels of a cell that encode its variant: a triangle lies in a plane
CELL_PIXELS = (
    8  # Stable Diffusion's, so that correspondences are met at the size that real weights have
)


def fine_schedule() -> Schedule:
    """Stable Diffusion's down to s = 1, below with s^3 in place of s.

    The picture is a small part of the latent, so the noise must end lower for it to be clean: at
    s = 2e-5, half an 8-bit step at 256x256 and the default radius.
    """
    ab = Schedule.scaled_linear().alphas_cumprod
    s = ((1 - ab) / ab).sqrt()
    return Schedule(1 / (1 + (s * s.clamp_max(1) ** 2) ** 2))


GAIN, HUE, SHIFT = 0.05, 4.0, 0.35
"""How 2D editors differ from view to view, as standard deviations: of the factor on all values,
about 1 (exposures differ; three sigma are a fifth of a stop); degrees about the grey axis (tints
differ, names of colors do not); pixels along each axis (a latent cell is 8). Single views of a
detailed photo are then 23 to 26 dB from the unperturbed variant, which shows when they are flicked
through; the mean of four views comes back to 27 to 31 dB."""
RADIUS = 2.5
"""Norm of the latent of a picture that is black or white everywhere, of any size, in units of the
noise: at the end of the consensus window (s = 4), variants half as far apart are still less than
one sigma apart."""
CODE_NORM = 4.5
"""Norm of all codes of a picture. Measured with 4 views over 12 seeds: from 2 to 3.5 views with few
matches do not agree yet; from 6.5 on each view has chosen before consensus acts."""
WIDTH = 0.03
"""w, standard deviation of a component in pixel values of [-1, 1]: below what is visible."""
SHARE = 0.1
"""a, the share of this edit in the image branch; agreement hardly depends on it."""


class Mixture(NamedTuple):
    """sum_k exp(log_weights[v, k]) N(base[v] + offsets[k, v], width^2 I): one mixture a view."""

    base: Float[Tensor, "v c y x"]
    offsets: Float[Tensor, "k v c y x"]
    log_weights: Float[Tensor, "v k"]
    """Logarithms of the weights, float64."""
    width: float

    def log_joint(self, q: Float[Tensor, "v c y x"], variance: float) -> Float[Tensor, "v k"]:
        """log p(k, q) but for a term that is common to all k, float64.

        q is a sample plus noise of that variance. The common term is -|q - base|^2 / (2 total):
        left in, it would drown the differences.
        """
        direction = (q - self.base).flatten(1).double()
        offsets = self.offsets.flatten(2).double()
        fit = torch.einsum("vn,kvn->vk", direction, offsets) - offsets.square().sum(-1).T / 2
        return self.log_weights + fit / (self.width**2 + variance)

    def log_density(self, q: Float[Tensor, "v c y x"], variance: float) -> Float[Tensor, " v"]:
        """log p(q) + n/2 log(2 pi), float64."""
        total = self.width**2 + variance
        distance = (q - self.base).flatten(1).double().square().sum(1)
        common = -distance / (2 * total) - q[0].numel() / 2 * math.log(total)
        return common + self.log_joint(q, variance).logsumexp(-1)

    def posterior_mean(
        self, q: Float[Tensor, "v c y x"], variance: float
    ) -> Float[Tensor, "v c y x"]:
        """Posterior mean E[x0 | q] of the clean latent."""
        weights = self.log_joint(q, variance).softmax(-1).to(q)  # p(k | q)
        center = self.base + torch.einsum("vk,kvcyx->vcyx", weights, self.offsets)
        return center + self.width**2 / (self.width**2 + variance) * (q - center)


class Condition(NamedTuple):
    """The conditional distributions of a batch."""

    text_image: Mixture
    image: Mixture


@dataclass(frozen=True, eq=False)
class ClosedForm:
    """The Denoiser: exact scores on a latent that is the picture itself, cell by cell."""

    spread: float = 1.0
    """Factor of how much the edits of views differ."""
    schedule: Schedule = field(default_factory=fine_schedule)
    name: str = "closed-form"
    cell: int = CELL_PIXELS
    multiple: int = CELL_PIXELS
    padding: PadMode = "edge"
    predicts: Prediction = "eps"

    @property
    def capabilities(self) -> Capabilities:
        """It runs no network."""
        return Capabilities()

    def check(self, prompt: str) -> None:
        """Raise UsageError if the instruction names no look."""
        parse(prompt)

    def encode(self, images: Float[Tensor, "v h w 3"]) -> Float[Tensor, "v c y x"]:
        """An isometry up to one factor: a cell's 8x8 pixels become channels; its code is 0."""
        pixels = (2 * images - 1).movedim(-1, 1)
        picture = self._scale(images.shape[1:3].numel()) * F.pixel_unshuffle(pixels, CELL_PIXELS)
        return F.pad(picture, (0, 0, 0, 0, 0, CODE))

    def decode(self, latents: Float[Tensor, "v c y x"]) -> Float[Tensor, "v h w 3"]:
        """The exact inverse of encode; codes are not seen."""
        pixels = F.pixel_shuffle(latents[:, :-CODE], CELL_PIXELS).movedim(1, -1)
        return pixels / (2 * self._scale(pixels.shape[1:3].numel())) + 0.5

    def condition(
        self, originals: Float[Tensor, "v h w 3"], prompt: str, generator: torch.Generator
    ) -> Condition:
        """Draws the perturbation of each view and places the components. Raises UsageError."""
        variants = perturb(parse(prompt).variants(originals), self.spread, generator)
        base = self.encode(originals)
        offsets = torch.stack([self.encode(variant) for variant in variants]) - base
        offsets[:, :, -CODE:] = self._codes(base)[:, None]
        width = WIDTH * self._scale(originals.shape[1:3].numel())
        # weights pi_k such that from the noised original every variant is as likely as another, at
        # the first time of 20 steps at strength 0.98
        ab = self.schedule.alpha(932)
        variance = width**2 + (1 - ab) / ab
        energy = offsets.flatten(2).double().square().sum(-1).T
        log_weights = (energy / (2 * variance)).log_softmax(-1)
        unedited = log_weights.new_full((len(base), 1), math.log1p(-SHARE))
        return Condition(
            Mixture(base, offsets, log_weights, width),
            Mixture(
                base,
                torch.cat((torch.zeros_like(offsets[:1]), offsets)),
                torch.cat((unedited, log_weights + math.log(SHARE)), 1),
                width,
            ),
        )

    def branches(
        self, x: Float[Tensor, "v c y x"], t: float, condition: Condition, need: Need
    ) -> Branches:
        """eps of the exact distributions that are needed."""
        ab = self.schedule.alpha(t)
        variance = (1 - ab) / ab
        q = x / ab**0.5

        def eps(x0: Tensor) -> Tensor:
            return (q - x0) / variance**0.5

        return Branches(
            eps(condition.text_image.posterior_mean(q, variance)) if need.text_image else None,
            eps(condition.image.posterior_mean(q, variance)) if need.image else None,
            eps(_prior_mean(q, variance, condition.image)) if need.none else None,
        )

    def find_ground_truth(
        self, prompt: str, edited: Float[Tensor, "v h w 3"], originals: Float[Tensor, "v h w 3"]
    ) -> GroundTruth:
        """The unperturbed variant that most views show, of any pictures."""
        recipe = parse(prompt)
        agreed, _ = agreed_variant(recipe, edited, originals)
        return partial(recipe.variant, k=agreed)

    def encode_edited(
        self, images: Float[Tensor, "v h w 3"], originals: Float[Tensor, "v h w 3"], prompt: str
    ) -> Float[Tensor, "v c y x"]:
        """Latents of finished edits: each cell's code is that of the variant the view shows."""
        _, votes = agreed_variant(parse(prompt), images, originals)
        latents = self.encode(images)
        latents[:, -CODE:] = self._codes(latents)[list(votes)]
        return latents

    def _codes(self, latents: Float[Tensor, "v c y x"]) -> Float[Tensor, "k d y x"]:
        """The corners of a regular triangle about 0, the same in every cell."""
        y, x = latents.shape[2:]
        angles = 2 * torch.pi / VARIANTS * torch.arange(VARIANTS).to(latents)
        corners = torch.stack((angles.cos(), angles.sin()), 1) * (CODE_NORM / (y * x) ** 0.5)
        return corners[:, :, None, None].expand(-1, -1, y, x)

    def _scale(self, pixels: int) -> float:
        """Latent units per unit of a value in [-1, 1]."""
        return RADIUS / math.sqrt(3 * pixels)


def _prior_mean(
    q: Float[Tensor, "v c y x"], variance: float, image: Mixture
) -> Float[Tensor, "v c y x"]:
    """E[x0 | q] of the branch without text and image."""
    n = q[0].numel()
    broad = -q.flatten(1).double().square().sum(1) / (2 * (1 + variance))
    broad = broad - n / 2 * math.log(1 + variance)
    is_picture = torch.sigmoid(image.log_density(q, variance) - n / 2 * math.log(2) - broad)
    is_picture = is_picture.to(q)[:, None, None, None]
    return torch.lerp(q / (1 + variance), image.posterior_mean(q, variance), is_picture)


def perturb(
    variants: Float[Tensor, "k v h w 3"], spread: float, generator: torch.Generator
) -> Float[Tensor, "k v h w 3"]:
    """Each view's own gain, hue and shift, the same for all its variants; in [0, 1]."""
    views = variants.shape[1]
    draws = torch.randn(views, 4, generator=generator, dtype=torch.float64)
    draws = spread * draws.to(variants)
    gain = 1 + GAIN * draws[:, 0]
    turned = torch.stack(
        [
            rotate_hue(images, HUE * float(angle))
            for images, angle in zip(variants.unbind(1), draws[:, 1])
        ],
        1,
    )
    shifted = torch.stack([_shift(images, SHIFT * draws[:, 2:]) for images in turned])
    return (shifted * gain[:, None, None, None]).clamp(0, 1)


def _shift(
    images: Float[Tensor, "v h w 3"], pixels: Float[Tensor, "v 2"]
) -> Float[Tensor, "v h w 3"]:
    """Move each picture right and down by fractions of a pixel, bicubic, edges repeated."""
    height, width = images.shape[1:3]
    theta = torch.eye(2, 3).to(images).repeat(len(images), 1, 1)
    theta[:, :, 2] = -2 * pixels / pixels.new_tensor((width, height))
    grid = F.affine_grid(theta, [len(images), 3, height, width], align_corners=False)
    moved = F.grid_sample(
        images.movedim(-1, 1), grid, mode="bicubic", padding_mode="border", align_corners=False
    )
    return moved.movedim(1, -1)
