"""A scene of fewer Gaussians that looks the same from afar, and what was done to it done to all.

Gaussians that are much smaller than the pixels of the pictures in which a scene is edited are
planned, looked at and fitted by groups: neighbors of about one size, as one Gaussian of their mean,
covariance and optical depth.

`n` Gaussians in `c` groups.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from gsedit.scene.framing import finest_pixels
from gsedit.scene.neighbors import interleave
from gsedit.scene.outcome import NEW, Outcome
from gsedit.scene.quaternions import principal_axes
from rasterizer.camera import Camera
from rasterizer.numerics import color_to_sh, sh_to_color
from rasterizer.project import rotation_matrices
from rasterizer.scene import Gaussians, concatenate

MAX_GAUSSIANS = 200_000
"""Gaussians that are edited one by one; of larger scenes, groups are."""
MOST_TOGETHER = 16
"""Gaussians of a group, on average: 58 left an edit of 10.9 million 4 dB farther off."""
LEVELS = 20
"""Halvings of each axis, of the box that holds all centers, down to the smallest group."""
SIZE_CLASSES = 8
"""Only Gaussians of one class make a group; a class has four times the size of the one below."""
STRAY_DISTANCE_BULKS = 500.0
"""Widths of the bulk beyond which a row is a stray: one would leave all others in one group."""
MOST_HALVINGS = 3
"""Groups of what is far or in no picture have at most 4**this as many Gaussians."""
PROBED_ROWS = 32
"""Neighbors of which one tells how large they are drawn."""
ROWS_AT_ONCE = 1 << 20
"""Rows that are worked on at a time: copies of a whole scene would double the memory."""
DARKEST_COLOR = 1 / 255
"""Base color to which one that changes is raised, as the optimizer does."""


@dataclass(frozen=True, eq=False)
class MergedScene:
    """A coarse scene, and where each Gaussian of the fine one is in it."""

    scene: Gaussians
    """The merged scene, `c` rows."""
    group: Int[Tensor, " n"]
    """Row of the coarse scene. int32."""
    fine: Gaussians
    """The scene that it stands for, `n` rows."""

    def majority(self, flags: Bool[Tensor, " n"]) -> Bool[Tensor, " c"]:
        """Groups at least half of whose Gaussians have the flag."""
        share = torch.zeros(len(self.scene)).index_add_(0, self.group, flags.float() - 0.5)
        return share >= 0

    def expand(self, flags: Bool[Tensor, " c"]) -> Bool[Tensor, " n"]:
        """To every Gaussian what its group has."""
        return flags.index_select(0, self.group)

    @torch.no_grad()
    def transfer(self, edited: Gaussians) -> Gaussians:
        """The fine scene with the colors and opacities changed as those of the coarse one were.

        Where a base color was lowered, the Gaussians' are lowered by the same factor: none becomes
        negative that is not. All other changes are added. Groups that are as they were stay
        exactly; so do geometry, and SH bands that the edited scene has not.
        """
        fine, k = self.fine, edited.sh.shape[1]
        start = replace(self.scene, sh=self.scene.sh[:, :k])
        changed = (edited.sh != start.sh).flatten(1).any(1)
        changed |= edited.logit_opacities != start.logit_opacities
        before, after = (
            sh_to_color(each.sh[:, 0]).clamp_min(DARKEST_COLOR) for each in (start, edited)
        )
        factor = (after / before).clamp_max(1)
        added = (after - before).clamp_min(0)
        rest = edited.sh[:, 1:] - start.sh[:, 1:]
        logits = edited.logit_opacities - start.logit_opacities
        sh, opacities = fine.sh.clone(), fine.logit_opacities.clone()
        for span in _spans(len(fine)):
            which = changed.index_select(0, self.group[span])
            rows = which.nonzero().squeeze(-1) + span.start
            group = self.group.index_select(0, rows)
            base = sh_to_color(sh[rows, 0]).clamp_min(DARKEST_COLOR)
            base = base * factor.index_select(0, group) + added.index_select(0, group)
            sh[rows, 0] = color_to_sh(base)
            sh[rows, 1:k] += rest.index_select(0, group)
            opacities[rows] += logits.index_select(0, group)
        return replace(fine, sh=sh, logit_opacities=opacities)

    def carry(self, made: Outcome) -> Gaussians:
        """The fine scene about as an outcome changes the coarse one: groups that stay where they
        are give what `transfer` does, all others come as they are made, in place of their own."""
        scene, rows = made.scene, made.origin.clamp_min(0)
        start, fine = (each.with_degree(scene.degree) for each in (self.scene, self.fine))
        stays = made.origin != NEW
        for name in ("means", "log_scales"):
            stays &= (getattr(scene, name) == getattr(start, name)[rows]).all(1)
        kept, old = torch.zeros(len(start), dtype=torch.bool), rows[stays]
        kept[old] = True
        sh, logits = start.sh.clone(), start.logit_opacities.clone()
        sh[old], logits[old] = scene.sh[stays], scene.logit_opacities[stays]
        edited = replace(start, sh=sh, logit_opacities=logits)
        moved = replace(self, scene=start, fine=fine).transfer(edited)[self.expand(kept)]
        return concatenate(moved, scene[~stays])


@torch.no_grad()
def coarsen(
    scene: Gaussians, most: int | None = None, cameras: Sequence[Camera] = ()
) -> MergedScene | None:
    """Merge a scene into about `most` groups; None where it has no more Gaussians than that.

    `most`: MAX_GAUSSIANS, with cameras more where groups would hold over MOST_TOGETHER on average.
    With cameras, groups hold four times as many Gaussians where these are twice as far from the
    nearest camera in whose picture they are, up to 4**MOST_HALVINGS times as many, and so many
    where they are in none.
    """
    if most is None:
        most = max(MAX_GAUSSIANS, len(scene) // MOST_TOGETHER if cameras else 0)
    if len(scene) <= most:
        return None
    codes = _codes(scene)
    order = codes.argsort(stable=True)
    codes = codes.index_select(0, order)
    halvings = _halvings(scene.means, order, cameras)
    parts = [(halvings == k).nonzero().squeeze(-1) for k in range(MOST_HALVINGS + 1)]
    share = most / sum(len(rows) / 4**k for k, rows in enumerate(parts))
    begins = []
    for k, rows in enumerate(parts):
        shared = _shared_levels(codes.index_select(0, rows))
        own = int(share * len(rows) / 4**k) or 1
        begins.append(_group_begins(shared, _least_together(shared, max(2, len(rows) // own), own)))
    group = torch.empty(len(scene), dtype=torch.int32)
    group[order.index_select(0, torch.cat(parts))] = (torch.cat(begins).cumsum(0) - 1).int()
    return MergedScene(_merged(scene, group, int(group.max()) + 1), group, scene)


def _halvings(
    means: Float[Tensor, "n 3"], order: Int[Tensor, " n"], cameras: Sequence[Camera]
) -> Int[Tensor, " n"]:
    """How often a row, in this order, is half as large in pixels as the nearest ones: at most
    MOST_HALVINGS times, and so often in no picture. One in PROBED_ROWS answers for its neighbors.
    """
    if not cameras:
        return torch.zeros(len(means), dtype=torch.int8)
    points = means.index_select(0, order[::PROBED_ROWS])
    finest = finest_pixels(points, cameras).reciprocal().nan_to_num(posinf=0.0)  # a unit
    if not (finest > 0).any():
        return torch.zeros(len(means), dtype=torch.int8)
    drawn = finest[finest > 0]
    # rows that are drawn larger than most others are the nearest
    near = drawn.kthvalue(1 + int(0.9 * (len(drawn) - 1))).values
    halvings = (near / finest).log2().floor().clamp(0, MOST_HALVINGS).to(torch.int8)
    return halvings.repeat_interleave(PROBED_ROWS)[: len(means)]


def _spans(count: int) -> list[slice]:
    return [slice(at, min(at + ROWS_AT_ONCE, count)) for at in range(0, count, ROWS_AT_ONCE)]


def _codes(scene: Gaussians) -> Int[Tensor, " n"]:
    """The class of size, then the place along a Z-curve: three bits a level, the coarsest first."""
    low, extent = _box(scene.means)
    place = ((scene.means - low).double() / extent * (1 << LEVELS)).long()
    place.clamp_(0, (1 << LEVELS) - 1)
    code = torch.from_numpy(interleave(place.numpy()).astype(np.int64))
    size = scene.log_scales.amax(1)
    classes = ((size - size.median()) / np.log(4) + SIZE_CLASSES / 2).long()
    return code | classes.clamp_(0, SIZE_CLASSES - 1) << 3 * LEVELS


def _box(means: Float[Tensor, "n 3"]) -> tuple[Float[Tensor, "3"], float]:
    """The lowest corner and the longest side of the box that holds the centers, but for strays.

    Strays lie STRAY_DISTANCE_BULKS times as far out as the middle 98 % of the rows are wide.
    """
    ends = [means.kthvalue(1 + int(share * (len(means) - 1)), 0).values for share in (0.01, 0.99)]
    reach = STRAY_DISTANCE_BULKS * (ends[1] - ends[0]).max()
    low = torch.maximum(means.amin(0), ends[0] - reach)
    high = torch.minimum(means.amax(0), ends[1] + reach)
    return low, float((high - low).max()) or 1.0


def _shared_levels(codes: Int[Tensor, " n"]) -> Int[Tensor, " n"]:
    """Levels down to which each row shares its group with the one before it; -1: not even a class.

    The codes ascend.
    """
    shared = torch.full((len(codes),), -1, dtype=torch.int8)
    for level in range(LEVELS + 1):
        part = codes >> 3 * (LEVELS - level)
        shared[1:][part[1:] == part[:-1]] = level
    return shared


def _least_together(shared: Int[Tensor, " n"], together: int, most: int) -> int:
    """The least size of groups, from `together` on in steps of an eighth, that makes no more than
    `most` of them (see `_group_begins`)."""
    sizes, bounds = [], []  # a part is a group where its size is allowed and its parent's is not
    begin, parent = torch.tensor([0]), torch.tensor([len(shared) + 1])
    for level in range(LEVELS + 1):
        at = (shared < level).nonzero().squeeze(-1)
        size = torch.diff(at, append=at.new_tensor([len(shared)]))
        bounds.append(parent[torch.searchsorted(begin, at, right=True) - 1])
        sizes.append(size if level < LEVELS else torch.ones_like(size))
        large = size > together  # no other is ever divided
        shared = shared[large.repeat_interleave(size, output_size=len(shared))]
        parent = size[large]
        begin = parent.cumsum(0) - parent
    size, bound = torch.cat(sizes), torch.cat(bounds)
    while int(((size <= together) & (together < bound)).sum()) > most:
        together += 1 + together // 8
    return together


def _group_begins(shared: Int[Tensor, " n"], together: int) -> Bool[Tensor, " n"]:
    """Flag the first row of each group: the largest ones of at most `together` rows, or of the last
    level."""
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


def _merged(scene: Gaussians, group: Int[Tensor, " n"], count: int) -> Gaussians:
    """One Gaussian a group; each row weighs as much as it covers."""
    k = scene.sh.shape[1]
    weight, means = torch.zeros(count), torch.zeros(count, 3)
    sh, covariances = torch.zeros(count, k, 3), torch.zeros(count, 3, 3)
    for span in _spans(len(scene)):
        part, at = scene[span], group[span]
        depth = -torch.log1p(-part.opacities.clamp_max(0.999)) * _area(part.scales)
        depth = depth.clamp_min(1e-30)
        weight.index_add_(0, at, depth)
        means.index_add_(0, at, part.means * depth[:, None])
        sh.index_add_(0, at, part.sh * depth[:, None, None])
    means /= weight[:, None]
    sh /= weight[:, None, None]
    for span in _spans(len(scene)):
        part, at = scene[span], group[span]
        depth = -torch.log1p(-part.opacities.clamp_max(0.999)) * _area(part.scales)
        share = depth.clamp_min(1e-30) / weight.index_select(0, at)
        axes = rotation_matrices(part.quats) * part.scales[:, None]
        apart = (part.means - means.index_select(0, at))[:, :, None]
        spread = axes @ axes.mT + apart @ apart.mT
        covariances.index_add_(0, at, spread * share[:, None, None])
    values, quats = principal_axes(covariances.double().numpy())
    scales = torch.from_numpy(np.sqrt(np.maximum(values, 1e-24))).float()
    opacity = -torch.expm1(-weight / _area(scales).clamp_min(1e-30))
    return Gaussians(
        means=means,
        quats=torch.from_numpy(quats).float(),
        log_scales=scales.log(),
        logit_opacities=torch.logit(opacity.clamp(1e-6, 0.99)),
        sh=sh,
    )
