"""The arms: how views are painted and the scene is fitted to them, one switch each from BASE.

`n` Gaussians; `v` views of `h w` pixels.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from math import inf
from typing import Literal, NamedTuple

import torch
from jaxtyping import Float
from kornia.filters import gaussian_blur2d
from torch import Tensor

from gsedit.capture.fitting.adam import BETA_1, BETA_2, EPSILON
from gsedit.capture.fitting.solve import solve_colors
from gsedit.capture.fitting.strokes import (
    GRAM_GRADIENT,
    LAST_RATE,
    RATE,
    Drawn,
    gradient_ratio,
    leading_views,
    led,
)
from gsedit.measures.features import FilterBank
from gsedit.measures.perceptual import perceptual_distance
from gsedit.paper.consistency.consensus import consensus
from gsedit.paper.consistency.correspond import Correspondences, correspond
from gsedit.paper.editors.painter.editor import Painter
from gsedit.paper.editors.painter.network import painted
from gsedit.paper.session import render_with_depth
from gsedit.paper.view_plan import random_plan
from gsedit.views.dataset import View
from gsedit.views.image_ops import pad_camera, pad_to_multiple
from gsedit.words.read import read_instruction
from rasterizer.color_weights import color_weights
from rasterizer.numerics import SH_DC
from rasterizer.render import render
from rasterizer.scene import Gaussians
from research.painting.cases import BATCHES, EACH, Case, Pictures, disagreement, energy

Loss = Literal["mse", "sum", "switch", "l1+perceptual"]
STEPS = 24
"""Steps of the descent from the solved scene, as in gsedit's settings."""
STEADY = RATE / 2
"""Rate of the strategies, which have a result at every second: none falls."""
ROUND = 10
"""Steps of an iterative update between two edits, as in Instruct-NeRF2NeRF."""
FIRST = 1 / 3
"""Share of the seconds that the combined strategy gives the single pass."""
BANK = FilterBank()
BLURS = tuple(0.2 * 1.05**k for k in range(60))
"""Deviations, pixels, among which a blur is looked for."""


@dataclass(frozen=True)
class Arm:
    """One way of editing; the defaults are BASE."""

    name: str
    views: Literal["planned", "random", "all"] = "planned"
    seed: int = 0
    blocks: int = 0
    """Residual blocks after which corresponding cells get their mean: T_end."""
    solve: Literal["none", "mean", "lead"] = "lead"
    """The scene where a descent begins: the unedited one, the solve where all views weigh alike, or
    that where one view leads."""
    steps: int = STEPS
    loss: Loss = "sum"
    ratio: float = GRAM_GRADIENT
    """Gradient of the Gram loss over that of the MSE at the first step."""


BASE = Arm("base")
ARMS = (
    BASE,
    Arm("lead", steps=0),
    Arm("mse", loss="mse"),
    Arm("ratio 1", ratio=1.0),
    Arm("switch", loss="switch"),
    *(Arm(f"agree in {k}", blocks=k) for k in (1, 6)),
    Arm("random", views="random"),
    Arm("solve", solve="mean", steps=0),
    Arm("no lead", solve="mean"),
    Arm("adam mse", solve="none", loss="mse", steps=2 * STEPS),
)
LATER = (
    Arm("l1+perceptual", loss="l1+perceptual"),
    Arm("all", views="all"),
    Arm("agree in 3", blocks=3),
    Arm("ratio 3", ratio=3.0),
    *(Arm("random", views="random", seed=seed) for seed in (1, 2)),
)
"""Arms that take longest or decide least: they run after all others."""

REPAINT = "repaint"


class Work(NamedTuple):
    """A scene after some work."""

    scene: Gaussians
    seconds: float
    """Processor seconds, without what all arms share."""
    steps: int
    edits: int
    """Views that were painted."""


class Bench:
    """The arms of a case in a style; what several share is made once, and its seconds count in
    each."""

    def __init__(self, case: Case, painter: Painter, style: str) -> None:
        self.case, self.painter, self.style = case, painter, style
        self.targets, self.start = cache(self._targets), cache(self._start)
        self.gram_weight = cache(self._gram_weight)

    def fitted(self, arm: Arm) -> Work:
        """The scene of an arm."""
        key = arm.views, arm.seed, arm.blocks
        targets, painting = self.targets(*key)
        scene, shares, solving = self.start(*key, arm.solve)
        begin = time.process_time()
        if arm.steps:
            descent = Descent(scene, self.case, arm.loss, arm.ratio, arm.seed)
            for i, target in targets.items():
                descent.put(i, target, shares.get(i))
            for step in range(arm.steps):
                falling = 1 - (1 - LAST_RATE) * step / arm.steps
                descent.step(descent.next_view(), RATE * falling)
            scene = descent.scene
        seconds = painting + solving + time.process_time() - begin
        return Work(scene, seconds, arm.steps, len(targets))

    def agreement(self, arm: Arm) -> dict[str, float | None]:
        """Meters of the painted views themselves, beside BASE's and beside BASE's blurred until
        they have the same energy."""
        case, base = self.case, self.targets("planned", 0, 0)[0]
        own = self.targets(arm.views, arm.seed, arm.blocks)[0]
        share = energy(list(own.values())) / energy(list(base.values()))
        found: dict[str, float | None] = {
            "target_energy": share,
            "target_disagreement": disagreement(case.among, case, own),
        }
        if arm.blocks:
            blurred = blurred_to(share * energy(list(base.values())), base)
            found["blurred_disagreement"] = disagreement(case.among, case, blurred)
        return found

    def _targets(
        self, views: str, seed: int, blocks: int
    ) -> tuple[dict[int, Float[Tensor, "h w 3"]], float]:
        """Painted views by index, and seconds."""
        case = self.case
        chosen = case.planned
        if views == "all":
            chosen = case.views
        elif views == "random":
            plan = random_plan(case.weights[list(case.views)], EACH, BATCHES, seed)
            chosen = tuple(case.views[i] for i in plan.views)
        matches = correspondences(case, chosen) if blocks else None  # in all arms, not counted
        begin = time.process_time()
        pictures = self.paint([case.unedited[i] for i in chosen], matches, blocks)
        return dict(zip(chosen, pictures)), time.process_time() - begin

    @torch.no_grad()
    def paint(
        self,
        pictures: Sequence[Float[Tensor, "h w 3"]],
        matches: Correspondences | None = None,
        blocks: int = 0,
    ) -> Float[Tensor, "v h w 3"]:
        """Pictures as the painter paints them; so many residual blocks end in agreement."""

        def agree(block: int, x: Tensor) -> Tensor:
            return consensus(x, matches.labels) if matches and block <= blocks else x

        style = self.painter.in_styles((read_instruction(self.style).changes[0].name,)).asked
        return painted(self.painter.network, torch.stack(list(pictures)), style, agree)

    def _start(
        self, views: str, seed: int, blocks: int, solve: str
    ) -> tuple[Gaussians, dict[int, Float[Tensor, "h w"] | None], float]:
        """The scene where a descent begins, the weights of pixels, and seconds."""
        case, targets = self.case, self.targets(views, seed, blocks)[0]
        begin, scene, weights = time.process_time(), case.scene, []
        if solve == "lead":
            leading = leading_views(case.weights[list(targets)], scene.means)
            weights = [led(scene, case.cameras[i], leading == k) for k, i in enumerate(targets)]
        if solve != "none":
            shown = [View(str(i), case.cameras[i], each) for i, each in targets.items()]
            every = torch.ones(len(scene), dtype=torch.bool)
            for found in solve_colors(scene, shown, every, weights=weights, band_penalty=inf):
                last = found
            scene = last.scene
        return scene, {i: w.wanted for i, w in zip(targets, weights)}, time.process_time() - begin

    def strategy(self, name: str, seconds: Sequence[float], seed: int = 0) -> Iterator[Work]:
        """The scene of a strategy after so many processor seconds each; all descend the sum at a
        steady rate, and Gram weighs the same in all."""
        case, chance = self.case, torch.Generator().manual_seed(seed)
        planned, start, spent, steps, edits = ("planned", 0, 0), case.scene, 0.0, 0, 0
        targets: Mapping[int, Tensor] = {i: case.unedited[i] for i in case.views}
        shares: Mapping[int, Tensor | None] = {}
        if name not in ("iterative", REPAINT):
            targets, spent = self.targets(*planned)
            edits = len(targets)
        if name == "solved":
            start, shares, solving = self.start(*planned, "lead")
            spent += solving
        descent = Descent(start, case, "sum", GRAM_GRADIENT, seed)
        descent.weight = self.gram_weight()
        for i, target in targets.items():
            descent.put(i, target, shares.get(i))
        begin = time.process_time() - spent
        for until in seconds:
            while (now := time.process_time() - begin) < until:
                if name in ("solved", "single") or (
                    name == "combined" and now < FIRST * seconds[-1]
                ):
                    descent.step(descent.next_view(), STEADY)
                    steps += 1
                    continue
                view = case.views[int(torch.randint(len(case.views), (), generator=chance))]
                shown = case.unedited[view]
                if name == REPAINT:
                    shown = descent.drawn(view).now(descent.change).detach().clamp(0, 1)
                descent.put(view, self.paint([shown])[0])
                edits += 1
                for _ in range(ROUND):
                    descent.step(descent.any_view(), STEADY)
                steps += ROUND
            spent = time.process_time() - begin
            yield Work(descent.scene, spent, steps, edits)
            begin = time.process_time() - spent

    def _gram_weight(self) -> float:
        """Lambda of BASE's first step, of every strategy."""
        targets, _ = self.targets("planned", 0, 0)
        scene, shares, _ = self.start("planned", 0, 0, "lead")
        descent = Descent(scene, self.case, "sum", GRAM_GRADIENT, 0)
        for i, target in targets.items():
            descent.put(i, target, shares[i])
        descent.step(descent.next_view(), 0.0)
        assert descent.weight is not None
        return descent.weight


class Descent:
    """Base colors that descend a loss by Adam, a whole view a step, as `stroke_steps` does."""

    def __init__(self, scene: Gaussians, case: Case, loss: Loss, ratio: float, seed: int) -> None:
        self._start, self.case, self.loss, self.ratio = scene, case, loss, ratio
        self.weight: float | None = None
        """That of the Gram loss; None: by the ratio, at the first step."""
        self.change = torch.zeros_like(scene.means, requires_grad=True)
        self._adam = torch.optim.Adam([self.change], RATE, (BETA_1, BETA_2), EPSILON)
        self._chance = torch.Generator().manual_seed(seed)
        self._targets: dict[int, tuple[Tensor, Tensor]] = {}
        self._drawn: dict[int, Drawn] = {}
        self._order: list[int] = []

    def put(
        self, i: int, target: Float[Tensor, "h w 3"], share: Float[Tensor, "h w"] | None = None
    ) -> None:
        """Make this the target of a view, with weights of pixels."""
        self._targets[i] = target, torch.ones_like(target[..., 0]) if share is None else share
        self._drawn.pop(i, None)

    def next_view(self) -> int:
        """A view, each once before any again."""
        views = list(self._targets)
        if not self._order:
            self._order = torch.randperm(len(views), generator=self._chance).tolist()
        return views[self._order.pop()]

    def any_view(self) -> int:
        """A view at random."""
        views = list(self._targets)
        return views[int(torch.randint(len(views), (), generator=self._chance))]

    def drawn(self, i: int) -> Drawn:
        """The target of a view, and how its picture depends on colors."""
        if i not in self._drawn:
            (target, share), camera = self._targets[i], self.case.cameras[i]
            with torch.no_grad():
                before = render(self._start, camera).color
            view = View(str(i), camera, target)
            weights = replace(color_weights(self._start, camera), wanted=share)
            self._drawn[i] = Drawn(weights, view, before, BANK)
        return self._drawn[i]

    def step(self, i: int, rate: float) -> None:
        """One step on a view."""
        self._adam.zero_grad()
        self._loss(self.drawn(i)).backward()
        self._adam.param_groups[0]["lr"] = rate
        self._adam.step()

    def _loss(self, view: Drawn) -> Tensor:
        now = view.now(self.change)
        if self.loss == "l1+perceptual":
            distance = perceptual_distance()
            assert distance is not None
            return (view.share.sqrt() * (now - view.target).abs()).mean() + distance(
                now, view.target
            )
        error = view.error(now)
        switches = self.loss == "switch" and self.weight is not None
        if self.loss == "mse" or (switches and torch.rand((), generator=self._chance) < 0.5):
            return error
        style = view.style(now)
        if self.weight is None:
            self.weight = self.ratio * gradient_ratio(error, style, self.change)
        return self.weight * style + (0 if self.loss == "switch" else error)

    @property
    def scene(self) -> Gaussians:
        """A copy of the scene as it is now."""
        sh = self._start.sh.clone()
        sh[:, 0] += self.change.detach() / SH_DC
        return replace(self._start, sh=sh)


def correspondences(case: Case, views: Sequence[int]) -> Correspondences:
    """Cells of the painter's bottleneck that show the same place, by the unedited scene's depth."""
    cell = Painter.cell
    shown = [render_with_depth(case.scene, case.cameras[i]) for i in views]
    depths = [each.median_depth for each in shown if each.median_depth is not None]
    return correspond(
        [pad_camera(case.cameras[i], cell) for i in views],
        pad_to_multiple(torch.stack(depths), cell, "constant"),
        pad_to_multiple(torch.stack([each.alpha for each in shown]), cell, "constant"),
        cell=cell,
    )


def blurred_to(goal: float, pictures: Pictures) -> dict[int, Float[Tensor, "h w 3"]]:
    """Pictures blurred by the least of BLURS that leaves no more energy than `goal`."""
    stack = torch.stack(list(pictures.values())).movedim(-1, 1)
    for sigma in BLURS:
        side = 2 * int(4 * sigma + 1) + 1
        blurred = gaussian_blur2d(stack, (side, side), (sigma, sigma)).movedim(1, -1)
        if energy(list(blurred)) <= goal:
            break
    return dict(zip(pictures, blurred))
