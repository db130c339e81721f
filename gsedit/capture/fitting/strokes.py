"""Strokes of drawn views, which no two views place alike, kept in a scene.

The mean of such views is mud. So every Gaussian follows one view, few in all, and
colors then descend the loss of Efficient-NeRF2NeRF from where they are: MSE + lambda Gram. `n`
Gaussians; `v` pictures of `h w` pixels.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor
from torch.nn.functional import embedding_bag

from gsedit.capture.fitting.adam import Adam
from gsedit.measures.features import FeatureExtractor
from gsedit.measures.losses import gram
from gsedit.run.step_threads import StepThreads
from gsedit.scene.neighbors import k_nearest
from gsedit.views.dataset import View
from rasterizer.camera import Camera
from rasterizer.color_weights import ColorWeights, color_weights
from rasterizer.numerics import SH_DC
from rasterizer.render import render_picture
from rasterizer.scene import Gaussians

NEAR, ROUNDS = 9, 2
"""Weights are averaged over so many near Gaussians, so many times: a view leads in patches."""
GOOD = 0.25
"""Share of what the best view sees of a place from which another may lead there: strokes are cut
where the lead changes, so that few views lead, each in as large a part as it can."""
LED = 0.97
"""Share of all that is seen beyond which no further view leads."""
LEAST_SHARE = 0.05
"""Share below which a pixel does not count: another view leads there."""
GRAM_GRADIENT = 10.0
"""Size of the Gram loss's gradient over that of the MSE, at the first step: lambda itself means
nothing without the units of the features."""
RATE = 0.03
"""Learning rate of colors in [0, 1]: with twice as much strokes are specks."""
LAST_RATE = 0.1
"""Share of the rate at the last step; it falls linearly."""


def leading_views(weights: Float[Tensor, "v n"], means: Float[Tensor, "n 3"]) -> Int[Tensor, " n"]:
    """The view that each Gaussian follows, -1 for none; `weights`: what each view sees of it.

    Few views lead: the next is always that which sees most of what none leads yet, wherever it sees
    at least the share GOOD of what the best view does.
    """
    points = means.detach().double().numpy()
    near = torch.from_numpy(k_nearest(points, points, min(NEAR, len(points)))[1])
    for _ in range(ROUNDS):
        weights = embedding_bag(near, weights.T.contiguous(), mode="mean").T
    best, leading = weights.amax(0), torch.full((len(means),), -1)
    able, free, chosen = weights >= GOOD * best, best > 0, list[int]()
    worth = weights * able
    while len(chosen) < len(weights) and best[free].sum() > (1 - LED) * best.sum():
        chosen.append(int((worth @ free.to(worth)).argmax()))
        taken = able[chosen[-1]] & free
        leading[taken], free = chosen[-1], free & ~taken
    if chosen:
        leading[free] = torch.tensor(chosen)[weights[chosen][:, free].argmax(0)]
    return leading


def led(scene: Gaussians, camera: Camera, leads: Bool[Tensor, " n"]) -> ColorWeights:
    """Weights of a view that leads these Gaussians: a pixel counts by its share of them, from
    LEAST_SHARE on."""
    weights = color_weights(scene, camera)
    share = weights.picture(leads.to(scene.means)[:, None].repeat(1, 3))[..., 0].clamp_max(1)
    return replace(weights, wanted=share * (share >= LEAST_SHARE))


def stroke_steps(
    scene: Gaussians,
    targets: Sequence[View],
    inside: Bool[Tensor, " n"],
    steps: int,
    features: FeatureExtractor,
    generator: torch.Generator,
    *,
    weights: Sequence[ColorWeights],
) -> Iterator[float | Gaussians]:
    """Yield the loss of every step, of a view, and last the scene; base colors `inside` move.

    `weights` are those of blending, and how much pixels count in the MSE. The Gram loss is relative
    to the targets' own: a sum over layers.
    """
    drawn = [
        Drawn(own, view, render_picture(scene, view.camera), features)
        for own, view in zip(weights, targets)
        if own.wanted is None or own.wanted.any()  # what leads nothing tells no ratio
    ]
    change = torch.zeros_like(scene.means, requires_grad=True)
    adam, weight, threads, order = Adam(), None, StepThreads(), list[int]()
    for step in range(steps if drawn else 0):
        order = order or torch.randperm(len(drawn), generator=generator).tolist()
        view = drawn[order.pop()]
        with threads.step():
            now = view.now(change * inside[:, None])
            error, style = view.error(now), view.style(now)
            if weight is None:
                weight = GRAM_GRADIENT * gradient_ratio(error, style, change)
            loss = error + weight * style
            (gradient,) = torch.autograd.grad(loss, change)
            rate = RATE * (1 - (1 - LAST_RATE) * step / steps)
            adam.step({"colors": change}, {"colors": gradient}, {"colors": rate})
        yield loss.item()
    sh = scene.sh.clone()
    sh[:, 0] += change.detach() * inside[:, None] / SH_DC
    yield replace(scene, sh=sh)


def gradient_ratio(
    error: Float[Tensor, ""], style: Float[Tensor, ""], change: Float[Tensor, "n 3"]
) -> float:
    """Size of the gradient of the error over that of the style; 0 where there is no style."""
    sizes = [
        torch.autograd.grad(each, change, retain_graph=True)[0].norm() for each in (error, style)
    ]
    return float(sizes[0] / sizes[1]) if sizes[1] > 0 else 0.0


class Drawn:
    """A target, and how its picture depends on base colors."""

    def __init__(
        self,
        weights: ColorWeights,
        target: View,
        picture: Float[Tensor, "h w 3"],
        features: FeatureExtractor,
    ) -> None:
        self.weights, self.picture, self.features = replace(weights, wanted=None), picture, features
        self.target, share = target.image, weights.wanted
        self.share = torch.ones(()) if share is None else share[..., None].square()
        with torch.no_grad():
            self.grams = [gram(each) for each in features(_channels_first(target.image))]

    def now(self, change: Float[Tensor, "n 3"]) -> Float[Tensor, "h w 3"]:
        """The picture with base colors changed by so much, not clamped."""
        return self.picture + _Picture.apply(change, self.weights)

    def error(self, now: Float[Tensor, "h w 3"]) -> Float[Tensor, ""]:
        """MSE of such a picture to the target, by the weights of pixels."""
        return (self.share * (now - self.target).square()).mean()

    def style(self, now: Float[Tensor, "h w 3"]) -> Float[Tensor, ""]:
        """Distance of its Gram matrices to the target's, relative to these."""
        own = [gram(each) for each in self.features(_channels_first(now))]
        style = [
            (ours - goal).square().sum() / goal.square().sum().clamp_min(1e-12)
            for ours, goal in zip(own, self.grams, strict=True)
        ]
        return torch.stack(style).sum()


class _Picture(torch.autograd.Function):
    """The change of a picture by a change of base colors, which is linear."""

    @staticmethod
    def forward(ctx: Any, change: Tensor, weights: ColorWeights) -> Tensor:
        ctx.weights = weights
        return weights.picture(change)

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, None]:
        return ctx.weights.back(gradient.contiguous()), None


def _channels_first(picture: Float[Tensor, "h w 3"]) -> Float[Tensor, "1 3 h w"]:
    return picture.movedim(-1, 0)[None]
