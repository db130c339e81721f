"""Adam over a scene's fields, a learning rate each. `n` Gaussians."""

from __future__ import annotations

from collections.abc import Mapping
from math import isqrt, log

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from gsedit.capture.fitting.adam import Adam
from gsedit.run.state import tensor_like
from rasterizer.numerics import color_to_sh
from rasterizer.scene import Gaussians

SH_REST = 1 / 20
"""View-dependent color learns this much slower than base color (Kerbl et al. 2023): it is where
contradictions between views would hide. A rate of its own: Adam does not feel a scaled gradient."""

LOWEST_COLOR = 1 / 255
"""Lowest base color of a Gaussian to be fitted: one step of an 8-bit picture, above the clamp at
0."""


LEAST_WIDTH = 0.3
"""Standard deviation along every axis, pixels of the photo that shows a Gaussian largest."""
LENGTH_A_PIXEL = 10.0
"""Longest axis, in lengths of the middle one for each pixel of the middle one: the thinner, the
shorter. Gaps between planks, which photos show, stay whole, and the granite of the bear has grains
and not scratches; with 3 lengths at any width gaps were rows of beads."""


@torch.no_grad()
def hold_shapes(log_scales: Float[Tensor, "n 3"], pixels: Float[Tensor, " n"]) -> None:
    """Widen what is thinner than LEAST_WIDTH pixels, shorten what is long for its width; in place.

    A Gaussian thinner than the photos' pixels costs nothing in them and is a scratch where a camera
    comes nearer (Yu et al. 2024, Mip-Splatting, section 4.1, who widen each Gaussian in the loss).
    Here the scene that is optimised is the one that is written.
    """
    log_pixels = pixels.log()[:, None]
    log_scales.clamp_min_(log(LEAST_WIDTH) + log_pixels)
    middle = log_scales.median(-1, keepdim=True).values
    log_scales.clamp_max_(2 * middle + log(LENGTH_A_PIXEL) - log_pixels)


class SceneOptimizer:
    """The one place where a scene changes: leaf tensors and their Adam moments, row for row.

    `rates` names the fields that move; "sh" moves its first coefficient at that rate, and the
    others `SH_REST` times slower. Rows that never get a gradient never move: their moments stay
    exactly zero.
    """

    def __init__(
        self, scene: Gaussians, rates: Mapping[str, float], *, compiled: bool = False
    ) -> None:
        """`compiled`: steps by a C++ kernel, where there is one; equal to rounding."""
        self._rates = dict(rates)
        values = vars(scene.detach())
        self._constant = {k: v for k, v in values.items() if k not in self._rates}
        self._leaves = {k: values[k].clone().requires_grad_() for k in self._rates}
        slow = torch.full((scene.sh.shape[1], 1), SH_REST)
        slow[0] = 1
        self._adam = Adam(shares={"sh": slow}, compiled=compiled)

    @property
    def scene(self) -> Gaussians:
        """The scene as leaves: gradients of anything computed from it reach the optimizer."""
        return Gaussians(**self._constant, **self._leaves)

    def __len__(self) -> int:
        return next(iter({**self._constant, **self._leaves}.values())).shape[0]

    def step(
        self, scale: Mapping[str, float] | float = 1.0, only: Bool[Tensor, " n"] | None = None
    ) -> None:
        """One Adam step at the fields' rates times `scale`; forgets the gradients.

        Rows outside `only` are taken to have no gradient.
        """
        rates = {
            name: rate * (scale if isinstance(scale, (int, float)) else scale.get(name, 1.0))
            for name, rate in self._rates.items()
        }
        gradients = {k: v.grad for k, v in self._leaves.items() if v.grad is not None}
        if only is not None:
            for gradient in gradients.values():
                gradient[~only] = 0
        self._adam.step(self._leaves, gradients, rates)
        for leaf in self._leaves.values():
            leaf.grad = None

    @torch.no_grad()
    def raise_negative_colors(self, only: Bool[Tensor, " n"]) -> None:
        """Raise base colors that are below 1/255 to it, in the rows `only`.

        A renderer clamps negative colors to 0, where they have no gradient: a leaf whose blue is
        negative would stay yellow whatever the pictures show. Captured scenes have many (10 % of
        the bear's Gaussians in blue). Does nothing where colors do not move.
        """
        sh = self._leaves.get("sh")
        if sh is not None:
            base = sh[:, :1]
            lowest = color_to_sh(LOWEST_COLOR)
            base.copy_(torch.where(only[:, None, None], base.clamp_min(lowest), base))

    def hold_shapes(self, pixels: Float[Tensor, " n"]) -> None:
        """`hold_shapes` of what moves; does nothing where scales do not."""
        if "log_scales" in self._leaves:
            hold_shapes(self._leaves["log_scales"], pixels)

    def replace(
        self, scene: Gaussians, origin: Int[Tensor, " n"], fresh: Bool[Tensor, " n"]
    ) -> None:
        """Continue with another scene: row i keeps row origin[i]'s moments unless it is fresh."""
        values = vars(scene.detach())
        self._constant = {name: values[name] for name in self._constant}
        self._leaves = {k: values[k].clone().requires_grad_() for k in self._rates}
        self._adam = self._adam.selected(origin, fresh)

    def state(self) -> dict[str, Tensor]:
        """Everything that changes here, by name: what moves, its moments, the number of steps."""
        leaves = {f"value.{name}": leaf.detach() for name, leaf in self._leaves.items()}
        return leaves | self._adam.state()

    @torch.no_grad()
    def load_state(self, state: Mapping[str, Tensor]) -> None:
        """Continue from a `state` of an optimizer of the same scene and rates.

        Raises ValueError where the names or shapes are others.
        """
        for name, leaf in self._leaves.items():
            leaf.copy_(tensor_like(state, f"value.{name}", leaf))
        self._adam.load_state(state, self._leaves)


def optimized_scene(state: Mapping[str, Tensor], start: Gaussians | None = None) -> Gaussians:
    """The scene of an optimizer's `state`: the one that it started from, with what moved.

    None for `start` where everything moves. Raises ValueError and TypeError for no such state.
    """
    still = {} if start is None else vars(start)
    moved = {k.removeprefix("value."): v for k, v in state.items() if k.startswith("value.")}
    scene = Gaussians(**{**still, **moved})
    n, *_ = scene.means.shape
    sh = (n, isqrt(scene.sh.shape[1]) ** 2, 3)
    shapes = ((n, 3), (n, 4), (n, 3), (n,), sh)
    wanted = [torch.empty(shape, device="meta") for shape in shapes]
    return Gaussians(*(tensor_like(vars(scene), k, each) for k, each in zip(vars(scene), wanted)))
