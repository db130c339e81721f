"""Adam over a scene's fields, a learning rate each, that survives adding and removing Gaussians."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields

import torch
from jaxtyping import Bool, Int
from torch import Tensor

from rasterizer.scene import Gaussians


class SceneOptimiser:
    """The one place where a scene changes: leaf tensors and their Adam moments, row for row.

    Fields that `rates` does not name are constants. Rows that never get a gradient never move:
    their
    moments stay exactly zero.
    """

    def __init__(self, scene: Gaussians, rates: Mapping[str, float]) -> None:
        self._rates = dict(rates)
        self._constant = {f.name: getattr(scene, f.name).detach() for f in fields(scene)}
        self._leaves: dict[str, Tensor] = {}
        self._start({name: self._constant.pop(name) for name in rates})

    def _start(self, values: Mapping[str, Tensor]) -> None:
        self._leaves = {k: v.detach().clone().requires_grad_() for k, v in values.items()}
        groups = [{"params": [v], "lr": self._rates[k]} for k, v in self._leaves.items()]
        # eps as 3D Gaussian splatting has it: gradients of single splats are tiny
        self._adam = torch.optim.Adam(groups, eps=1e-15, fused=True)

    @property
    def scene(self) -> Gaussians:
        """The scene as leaves: gradients of anything computed from it reach the optimiser."""
        return Gaussians(**self._constant, **self._leaves)

    def gradient(self, name: str) -> Tensor:
        """Gradient of one field after a backward pass; zeros if there is none."""
        leaf = self._leaves[name]
        return torch.zeros_like(leaf) if leaf.grad is None else leaf.grad

    def step(self, scale: Mapping[str, float] | float = 1.0) -> None:
        """One Adam step at the fields' rates times `scale`; forgets the gradients."""
        for group, name in zip(self._adam.param_groups, self._leaves):
            group["lr"] = self._rates[name] * (
                scale if isinstance(scale, (int, float)) else scale.get(name, 1.0)
            )
        self._adam.step()
        self._adam.zero_grad(set_to_none=True)

    def replace(
        self, scene: Gaussians, origin: Int[Tensor, " n"], fresh: Bool[Tensor, " n"]
    ) -> None:
        """Continue with another scene: row i keeps row origin[i]'s moments unless it is fresh."""
        moments = {k: self._adam.state.get(v, {}) for k, v in self._leaves.items()}
        self._constant = {name: getattr(scene, name).detach() for name in self._constant}
        self._start({name: getattr(scene, name) for name in self._leaves})
        for name, leaf in self._leaves.items():
            if not moments[name]:
                continue
            old = moments[name]
            kept = {k: old[k][origin].clone() for k in ("exp_avg", "exp_avg_sq")}
            for value in kept.values():
                value[fresh] = 0
            self._adam.state[leaf] = {"step": old["step"], **kept}
