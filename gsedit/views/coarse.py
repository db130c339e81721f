"""A scene of fewer Gaussians that looks the same from afar, and what was done to it done to all.

Gaussians that are much smaller than the pixels of the pictures in which a scene is edited are
planned, looked at and fitted by cells: neighbours of about one size, as one Gaussian of their mean,
covariance and optical depth.

`n` Gaussians in `c` cells.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from scipy.spatial.transform import Rotation
from torch import Tensor

from rasterizer.numerics import SH_DC
from rasterizer.project import rotation_matrices
from rasterizer.scene import Gaussians

MOST = 200_000
"""Gaussians that are edited one by one; of larger scenes, cells are."""
LEVELS = 20
"""Halvings of each axis, of the box that holds all centres, down to the smallest cell."""
SIZE_CLASSES = 8
"""Only Gaussians of one class make a cell; a class has four times the size of the one below."""
AT_ONCE = 1 << 20
"""Rows that are worked on at a time: copies of a whole scene would double the memory."""
DARKEST = 1 / 255
"""Base colour to which one that changes is raised, as the optimiser does."""


@dataclass(frozen=True, eq=False)
class Coarse:
    """A coarse scene, and where each Gaussian of the fine one is in it."""

    scene: Gaussians
    """`c` rows."""
    cell: Int[Tensor, " n"]
    """Row of the coarse scene. int32."""
    fine: Gaussians
    """The scene that it stands for, `n` rows."""

    def majority(self, flags: Bool[Tensor, " n"]) -> Bool[Tensor, " c"]:
        """Cells at least half of whose Gaussians have the flag."""
        share = torch.zeros(len(self.scene)).index_add_(0, self.cell, flags.float() - 0.5)
        return share >= 0

    def expand(self, flags: Bool[Tensor, " c"]) -> Bool[Tensor, " n"]:
        """To every Gaussian what its cell has."""
        return flags.index_select(0, self.cell)

    @torch.no_grad()
    def transfer(self, edited: Gaussians) -> Gaussians:
        """The fine scene with the colours and opacities changed as those of the coarse one were.

        Where a base colour was lowered, the Gaussians' are lowered by the same factor: none becomes
        negative that is not. All other changes are added. Cells that are as they were stay exactly;
        so do geometry, and SH bands that the edited scene has not.
        """
        fine, k = self.fine, edited.sh.shape[1]
        start = replace(self.scene, sh=self.scene.sh[:, :k])
        changed = (edited.sh != start.sh).flatten(1).any(1)
        changed |= edited.logit_opacities != start.logit_opacities
        before, after = (_base(each.sh).clamp_min(DARKEST) for each in (start, edited))
        factor = (after / before).clamp_max(1)
        added = (after - before).clamp_min(0)
        rest = edited.sh[:, 1:] - start.sh[:, 1:]
        logits = edited.logit_opacities - start.logit_opacities
        sh, opacities = fine.sh.clone(), fine.logit_opacities.clone()
        for span in _spans(len(fine)):
            which = changed.index_select(0, self.cell[span])
            rows = which.nonzero().squeeze(-1) + span.start
            cell = self.cell.index_select(0, rows)
            base = _base(sh[rows]).clamp_min(DARKEST)
            base = base * factor.index_select(0, cell) + added.index_select(0, cell)
            sh[rows, 0] = (base - 0.5) / SH_DC
            sh[rows, 1:k] += rest.index_select(0, cell)
            opacities[rows] += logits.index_select(0, cell)
        return replace(fine, sh=sh, logit_opacities=opacities)


@torch.no_grad()
def coarsen(scene: Gaussians, most: int | None = None) -> Coarse | None:
    """Cells of the scene, `most` (MOST) at most; None where it has no more Gaussians than that."""
    most = most or MOST
    if len(scene) <= most:
        return None
    codes = _codes(scene)
    order = codes.argsort(stable=True)
    codes = codes.index_select(0, order)
    shared = _shared_levels(codes)
    together = max(2, len(scene) // most)
    while int((begins := _cell_begins(shared, together)).sum()) > most:
        together += 1 + together // 8
    cell = torch.empty(len(scene), dtype=torch.int32)
    cell[order] = (begins.cumsum(0) - 1).int()
    return Coarse(_merged(scene, cell, int(begins.sum())), cell, scene)


def _spans(count: int) -> list[slice]:
    return [slice(at, min(at + AT_ONCE, count)) for at in range(0, count, AT_ONCE)]


def _base(sh: Float[Tensor, "n k 3"]) -> Float[Tensor, "n 3"]:
    return 0.5 + SH_DC * sh[:, 0]


def _codes(scene: Gaussians) -> Int[Tensor, " n"]:
    """The class of size, then the place along a Z-curve: three bits a level, the coarsest first."""
    low = scene.means.amin(0)
    extent = float((scene.means.amax(0) - low).max()) or 1.0
    place = ((scene.means - low).double() / extent * (1 << LEVELS)).long()
    place.clamp_(0, (1 << LEVELS) - 1)
    code = torch.zeros(len(scene), dtype=torch.int64)
    for axis in range(3):
        bits = place[:, axis]
        for shift, mask in _SPREADS:
            bits = (bits | bits << shift) & mask
        code |= bits << axis
    size = scene.log_scales.amax(1)
    classes = ((size - size.median()) / np.log(4) + SIZE_CLASSES / 2).long()
    return code | classes.clamp_(0, SIZE_CLASSES - 1) << 3 * LEVELS


_SPREADS = (
    (32, 0x1F00000000FFFF), (16, 0x1F0000FF0000FF), (8, 0x100F00F00F00F00F),
    (4, 0x10C30C30C30C30C3), (2, 0x1249249249249249),
)  # fmt: skip
"""From 20 consecutive bits to every third bit (shift and mask, one after the other)."""


def _shared_levels(codes: Int[Tensor, " n"]) -> Int[Tensor, " n"]:
    """Levels down to which each row shares its cell with the one before it; -1: not even a class.

    The codes ascend.
    """
    shared = torch.full((len(codes),), -1, dtype=torch.int8)
    for level in range(LEVELS + 1):
        part = codes >> 3 * (LEVELS - level)
        shared[1:][part[1:] == part[:-1]] = level
    return shared


def _cell_begins(shared: Int[Tensor, " n"], together: int) -> Bool[Tensor, " n"]:
    """Where a cell begins: the largest cells of at most so many rows, or of the last level."""
    begins = torch.zeros(len(shared), dtype=torch.bool)
    open_ = torch.ones(len(shared), dtype=torch.bool)
    for level in range(LEVELS + 1):
        at = (shared < level).nonzero().squeeze(-1)
        counts = torch.diff(at, append=at.new_tensor([len(shared)]))
        small = (counts <= together) if level < LEVELS else torch.ones_like(at, dtype=torch.bool)
        begins[at[small & open_[at]]] = True
        open_ &= ~small.repeat_interleave(counts, output_size=len(shared))
        if not open_.any():
            break
    return begins


def _area(scales: Float[Tensor, "n 3"]) -> Float[Tensor, " n"]:
    """About the area that a Gaussian shows from all sides, in units of its own."""
    a, b, c = scales.unbind(-1)
    return ((a * b).square() + (b * c).square() + (c * a).square()).sqrt()


def _merged(scene: Gaussians, cell: Int[Tensor, " n"], count: int) -> Gaussians:
    """One Gaussian a cell; each row weighs as much as it covers."""
    k = scene.sh.shape[1]
    weight, means = torch.zeros(count), torch.zeros(count, 3)
    sh, covariances = torch.zeros(count, k, 3), torch.zeros(count, 3, 3)
    for span in _spans(len(scene)):
        part, at = scene[span], cell[span]
        depth = -torch.log1p(-part.opacities.clamp_max(0.999)) * _area(part.scales)
        depth = depth.clamp_min(1e-30)
        weight.index_add_(0, at, depth)
        means.index_add_(0, at, part.means * depth[:, None])
        sh.index_add_(0, at, part.sh * depth[:, None, None])
    means /= weight[:, None]
    sh /= weight[:, None, None]
    for span in _spans(len(scene)):
        part, at = scene[span], cell[span]
        depth = -torch.log1p(-part.opacities.clamp_max(0.999)) * _area(part.scales)
        share = depth.clamp_min(1e-30) / weight.index_select(0, at)
        axes = rotation_matrices(part.quats) * part.scales[:, None]
        apart = (part.means - means.index_select(0, at))[:, :, None]
        spread = axes @ axes.mT + apart @ apart.mT
        covariances.index_add_(0, at, spread * share[:, None, None])
    values, vectors = np.linalg.eigh(covariances.double().numpy())
    vectors[:, :, 0] *= np.linalg.det(vectors)[:, None]  # a rotation, no mirror image
    x, y, z, w = Rotation.from_matrix(vectors).as_quat().T
    scales = torch.from_numpy(np.sqrt(np.maximum(values, 1e-24))).float()
    opacity = -torch.expm1(-weight / _area(scales).clamp_min(1e-30))
    return Gaussians(
        means=means,
        quats=torch.from_numpy(np.stack((w, x, y, z), 1)).float(),
        log_scales=scales.log(),
        logit_opacities=torch.logit(opacity.clamp(1e-6, 0.99)),
        sh=sh,
    )
