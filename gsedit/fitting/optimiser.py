"""Adam over a scene's fields, a learning rate each, that survives adding and removing Gaussians."""

from __future__ import annotations

from collections.abc import Mapping

import torch
from jaxtyping import Bool, Int
from torch import Tensor

from rasterizer.numerics import SH_DC
from rasterizer.scene import Gaussians

SH_REST = 1 / 20
"""View-dependent colour learns this much slower than base colour (Kerbl et al. 2023): it is where
contradictions between views would hide. A rate of its own: Adam does not feel a scaled gradient."""

LOWEST_COLOUR = 1 / 255
"""Of a Gaussian that is to be fitted: one step of an 8-bit picture, above the clamp at 0."""


class SceneOptimiser:
    """The one place where a scene changes: leaf tensors and their Adam moments, row for row.

    `rates` names the fields that move; "sh" moves its first coefficient at that rate, and the
    others `SH_REST` times slower. Rows that never get a gradient never move: their moments stay
    exactly zero.
    """

    def __init__(self, scene: Gaussians, rates: Mapping[str, float]) -> None:
        self._rates = dict(rates)
        if "sh" in rates:
            self._rates |= {"sh": rates["sh"], "sh_rest": rates["sh"] * SH_REST}
        values = _parts(scene)
        self._constant = {k: v.detach() for k, v in values.items() if k not in self._rates}
        self._leaves: dict[str, Tensor] = {}
        self._start(values)

    def _start(self, values: Mapping[str, Tensor]) -> None:
        self._leaves = {k: values[k].detach().clone().requires_grad_() for k in self._rates}
        groups = [{"params": [v], "lr": self._rates[k]} for k, v in self._leaves.items()]
        # eps as 3D Gaussian splatting has it: gradients of single splats are tiny
        self._adam = torch.optim.Adam(groups, eps=1e-15, fused=True)

    @property
    def scene(self) -> Gaussians:
        """The scene as leaves: gradients of anything computed from it reach the optimiser."""
        parts = {**self._constant, **self._leaves}
        rest = parts.pop("sh_rest")
        sh = torch.cat((parts.pop("sh"), rest), 1) if rest.shape[1] else parts.pop("sh")
        return Gaussians(**parts, sh=sh)

    def gradient(self, name: str) -> Tensor:
        """Gradient of one field after a backward pass; zeros if there is none."""
        leaf = self._leaves[name]
        return torch.zeros_like(leaf) if leaf.grad is None else leaf.grad

    def step(
        self, scale: Mapping[str, float] | float = 1.0, only: Bool[Tensor, " n"] | None = None
    ) -> None:
        """One Adam step at the fields' rates times `scale`; forgets the gradients.

        Rows outside `only` are taken to have no gradient.
        """
        for group, (name, leaf) in zip(self._adam.param_groups, self._leaves.items()):
            factor = scale if isinstance(scale, (int, float)) else scale.get(_field(name), 1.0)
            group["lr"] = self._rates[name] * factor
            if only is not None and leaf.grad is not None:
                leaf.grad[~only] = 0
        self._adam.step()
        self._adam.zero_grad(set_to_none=True)

    @torch.no_grad()
    def raise_negative_colours(self, only: Bool[Tensor, " n"]) -> None:
        """Raise base colours that are below 1/255 to it, in the rows `only`.

        A renderer clamps negative colours to 0, where they have no gradient: a leaf whose blue is
        negative would stay yellow whatever the pictures show. Captured scenes have many (10 % of
        the bear's Gaussians in blue). Does nothing where colours do not move.
        """
        base = self._leaves.get("sh")
        if base is not None:
            lowest = (LOWEST_COLOUR - 0.5) / SH_DC
            base.copy_(torch.where(only[:, None, None], base.clamp_min(lowest), base))

    def replace(
        self, scene: Gaussians, origin: Int[Tensor, " n"], fresh: Bool[Tensor, " n"]
    ) -> None:
        """Continue with another scene: row i keeps row origin[i]'s moments unless it is fresh."""
        moments = {k: self._adam.state.get(v, {}) for k, v in self._leaves.items()}
        values = _parts(scene)
        self._constant = {name: values[name].detach() for name in self._constant}
        self._start(values)
        for name, leaf in self._leaves.items():
            if not moments[name]:
                continue
            old = moments[name]
            kept = {k: old[k][origin].clone() for k in ("exp_avg", "exp_avg_sq")}
            for value in kept.values():
                value[fresh] = 0
            self._adam.state[leaf] = {"step": old["step"], **kept}


def _parts(scene: Gaussians) -> dict[str, Tensor]:
    """The scene's fields, with the view-dependent coefficients apart."""
    return {
        "means": scene.means,
        "quats": scene.quats,
        "log_scales": scene.log_scales,
        "logit_opacities": scene.logit_opacities,
        "sh": scene.sh[:, :1],
        "sh_rest": scene.sh[:, 1:],
    }


def _field(part: str) -> str:
    return "sh" if part == "sh_rest" else part
