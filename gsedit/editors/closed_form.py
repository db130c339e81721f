"""A diffusion model of edited pictures whose score is known exactly: no weights, a known answer.

`v` views, `k` components, `c y x` latents. In units of a clean latent, a noised one is
q = x_t / sqrt(ab) = x0 + s n with unit noise n and s^2 = (1 - ab) / ab.

For a picture z (its latent) and an instruction, whose variants have latents m_k:
  text + image   sum_k pi_k N(m_k, w^2): the variants, each as this view's editor would render it
  image alone    (1 - a) N(z, w^2) + a (text + image): the picture as it is; with the text dropped,
                 this edit remains one possibility among all. Marginalising the instruction demands
                 that share: it also ends the push of guidance where it has done its work (below)
  neither        N(0, 1): a prior far broader than the pictures
Each branch's eps is (q - E[x0 | q]) / s with the posterior mean in closed form.

Guidance. Far from the variants the image branch answers z, so 7.5 / 1.5 pushes along 6 (m - z)
beyond 1.5 m; near one of them it answers m_k too, and s_T falls out of the formula. Sampling then
contracts at w^2's own rate for every s_T. (A single broad Gaussian instead of the mixture, of
precision 1 / s_I^2 << 7.5 / w^2, has the right limit too, but its guided ODE has slope 1 - s_T in
log s: 20 Euler steps of it diverge.)

Choice of variant. All a view's cells choose together, by <q, m_j - m_k> / s^2. With one latent unit
per pixel value this is decided within the first step at any useful size, before views can agree;
so latents are scaled such that a picture's norm does not depend on its size (`Shape.radius`):
the larger the picture, the more noise hides it (Hoogeboom et al. 2023, simple diffusion). A value
of a pixel is then a small number, and the schedule must end at a smaller noise (`fine_schedule`).
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

from gsedit.diffusion import Answer, Branches, Schedule
from gsedit.editors.looks import agreed_variant, parse

CELL = 8  # Stable Diffusion's, so that correspondences are met at the size that real weights have
FIRST_T = 932  # the first time of 20 steps at strength 0.98: where the variants are equally likely


def fine_schedule() -> Schedule:
    """Stable Diffusion's where s >= 1, with s^2 in place of s below: 20 dB less noise at the end.

    The end, s = 0.0009, is a hundredth of a pixel's range at 256x256 and the default radius.
    """
    ab = Schedule.scaled_linear().alphas_cumprod
    s = ((1 - ab) / ab).sqrt()
    return Schedule(1 / (1 + (s * s.clamp_max(1)) ** 2))


@dataclass(frozen=True)
class Perturbation:
    """What 2D editors do differently from view to view, as standard deviations.

    Each is evident when views are flicked through and small enough that 4 fused views still give
    26 dB or more against the unperturbed variant.
    """

    gain: float = 0.05
    """Of the factor on all values: exposure flicker, half a stop at the far end."""
    hue: float = 4.0
    """Degrees about the grey axis: tints drift, names of colours do not change."""
    shift: float = 0.35
    """Pixels along each axis: a latent cell is 8, so structure is placed to a fraction of it."""


@dataclass(frozen=True)
class Shape:
    """The widths of the distributions, measured to give choices that views can still agree on."""

    radius: float = 25.0
    """Norm of the latent of a picture that is black or white everywhere. At the first step s = 11:
    variants half as far apart (0.25 in colour) are then separated by about one standard deviation,
    and by the end of the consensus window (s = 4) by three."""
    width: float = 0.03
    """w, standard deviation of a component in pixel values of [-1, 1]: below what is seen."""
    share: float = 0.1
    """a, the share of this edit in the image branch."""


class Mixture(NamedTuple):
    """sum_k exp(log_weights[v, k]) N(base[v] + offsets[k, v], width^2 I): one mixture a view."""

    base: Float[Tensor, "v c y x"]
    offsets: Float[Tensor, "k v c y x"]
    log_weights: Float[Tensor, "v k"]
    """float64."""
    width: float

    def responsibilities(
        self, q: Float[Tensor, "v c y x"], variance: float
    ) -> Float[Tensor, "v k"]:
        """p(k | q), float64, where q is a sample plus noise of that variance."""
        direction = (q - self.base).flatten(1).double()
        offsets = self.offsets.flatten(2).double()
        # |q - base - offset|^2 without |q - base|^2: common to all k, and it would drown the rest
        fit = torch.einsum("vn,kvn->vk", direction, offsets) - offsets.square().sum(-1).T / 2
        return (self.log_weights + fit / (self.width**2 + variance)).softmax(-1)

    def posterior_mean(
        self, q: Float[Tensor, "v c y x"], variance: float
    ) -> Float[Tensor, "v c y x"]:
        """E[x0 | q]."""
        weights = self.responsibilities(q, variance).to(q)
        centre = self.base + torch.einsum("vk,kvcyx->vcyx", weights, self.offsets)
        return centre + self.width**2 / (self.width**2 + variance) * (q - centre)


class Condition(NamedTuple):
    """The conditional distributions of a batch."""

    text_image: Mixture
    image: Mixture


@dataclass(frozen=True, eq=False)
class ClosedForm:
    """The Denoiser: exact scores on a latent that is the picture itself, cell by cell."""

    perturbation: Perturbation = Perturbation()
    shape: Shape = Shape()
    schedule: Schedule = field(default_factory=fine_schedule)
    name: str = "closed-form"
    cell: int = CELL
    channels: int = 3 * CELL * CELL

    def check(self, prompt: str) -> None:
        """Raise UsageError if the instruction names no look."""
        parse(prompt)

    def encode(self, images: Float[Tensor, "v h w 3"]) -> Float[Tensor, "v c y x"]:
        """An isometry up to one factor: the values of each cell of 8x8 pixels become channels."""
        pixels = (2 * images - 1).movedim(-1, 1)
        return self._scale(images.shape[1:3].numel()) * F.pixel_unshuffle(pixels, CELL)

    def decode(self, latents: Float[Tensor, "v c y x"]) -> Float[Tensor, "v h w 3"]:
        """The exact inverse of encode."""
        pixels = F.pixel_shuffle(latents, CELL).movedim(1, -1)
        return pixels / (2 * self._scale(pixels.shape[1:3].numel())) + 0.5

    def condition(
        self, originals: Float[Tensor, "v h w 3"], prompt: str, generator: torch.Generator
    ) -> Condition:
        """Draws the perturbation of each view and places the components. Raises UsageError."""
        variants = perturb(parse(prompt).variants(originals), self.perturbation, generator)
        base = self.encode(originals)
        offsets = torch.stack([self.encode(variant) for variant in variants]) - base
        width = self.shape.width * self._scale(originals.shape[1:3].numel())
        # weights pi_k such that from the noised original every variant is as likely as another
        ab = self.schedule.alpha(FIRST_T)
        variance = width**2 + (1 - ab) / ab
        energy = offsets.flatten(2).double().square().sum(-1).T
        log_weights = (energy / (2 * variance)).log_softmax(-1)
        share = self.shape.share
        unedited = log_weights.new_full((len(base), 1), math.log1p(-share))
        return Condition(
            Mixture(base, offsets, log_weights, width),
            Mixture(
                base,
                torch.cat((torch.zeros_like(offsets[:1]), offsets)),
                torch.cat((unedited, log_weights + math.log(share)), 1),
                width,
            ),
        )

    def branches(
        self, x: Float[Tensor, "v c y x"], t: int, condition: Condition, need_none: bool
    ) -> Branches:
        """eps of the three exact distributions."""
        ab = self.schedule.alpha(t)
        variance = (1 - ab) / ab
        q = x / ab**0.5

        def eps(x0: Tensor) -> Tensor:
            return (q - x0) / variance**0.5

        return Branches(
            eps(condition.text_image.posterior_mean(q, variance)),
            eps(condition.image.posterior_mean(q, variance)),
            eps(q / (1 + variance)) if need_none else None,
        )

    def answer(
        self,
        prompt: str,
        edited: Float[Tensor, "v h w 3"],
        originals: Float[Tensor, "v h w 3"],
    ) -> Answer:
        """The unperturbed variant that most views show, of any pictures."""
        recipe = parse(prompt)
        agreed, _ = agreed_variant(recipe, edited, originals)
        return partial(recipe.variant, k=agreed)

    def _scale(self, pixels: int) -> float:
        """Latent units per unit of a value in [-1, 1]."""
        return self.shape.radius / math.sqrt(3 * pixels)


def perturb(
    variants: Float[Tensor, "k v h w 3"], perturbation: Perturbation, generator: torch.Generator
) -> Float[Tensor, "k v h w 3"]:
    """Each view's own gain, hue and shift, the same for all its variants; in [0, 1]."""
    views = variants.shape[1]
    draws = torch.randn(views, 4, generator=generator, dtype=torch.float64).to(variants)
    gain = 1 + perturbation.gain * draws[:, 0]
    turned = torch.stack(
        [
            images @ _hue_rotation(math.radians(perturbation.hue) * float(angle)).to(images).T
            for images, angle in zip(variants.unbind(1), draws[:, 1])
        ],
        1,
    )
    shifted = torch.stack([_shift(images, perturbation.shift * draws[:, 2:]) for images in turned])
    return (shifted * gain[:, None, None, None]).clamp(0, 1)


def _hue_rotation(angle: float) -> Float[Tensor, "3 3"]:
    """Rotation of colours about the grey axis (Rodrigues' formula), radians."""
    third = torch.full((3, 3), 1 / 3, dtype=torch.float64)
    cross = torch.tensor([[0, -1, 1], [1, 0, -1], [-1, 1, 0]], dtype=torch.float64) / math.sqrt(3)
    identity = torch.eye(3, dtype=torch.float64)
    return math.cos(angle) * (identity - third) + third + math.sin(angle) * cross


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
