"""Consensus of corresponding cells while views are sampled, and the noise that they share.

`v` views, `c` channels, `y x` latent cells, `n` = y x cells in a view, `k` clusters, `m` cells that
are in one. Labels name each cell's cluster, -1 for none; a cluster has at most one cell a view.
"""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor


def consensus(
    x: Float[Tensor, "v c y x"],
    labels: Int[Tensor, "v y x"],
    *,
    anchored: Bool[Tensor, " v"] | None = None,
) -> Float[Tensor, "v c y x"]:
    """Replace every cell by its cluster's mean: the nearest x that agrees at all correspondences.

    Where a cluster has cells of anchored views, its value is the mean of those alone and they stay
    as they are. Cells in no cluster are untouched. This is a linear projection, idempotent and
    blind to the order of views. Differentiable. It is eq. (averageall) of Efficient-NeRF2NeRF for
    any number of views.
    """
    values, rows, cluster, count = _members(x, labels)
    if not len(rows):
        return x
    weight = torch.ones(len(rows), dtype=x.dtype, device=x.device)
    follows = torch.ones(len(rows), dtype=torch.bool, device=x.device)
    if anchored is not None:
        leads = anchored[rows // labels[0].numel()]
        led = torch.zeros(count, dtype=torch.bool, device=x.device)
        led[cluster[leads]] = True
        weight = (leads | ~led[cluster]).to(x.dtype)
        follows = ~leads
    weighted = values[rows] * weight[:, None]
    total = weight.new_zeros(count, x.shape[1]).index_add(0, cluster, weighted)
    mean = total / weight.new_zeros(count).index_add(0, cluster, weight)[:, None]
    return _as_grid(values.index_copy(0, rows[follows], mean[cluster][follows]), x)


def share_noise(
    noise: Float[Tensor, "v c y x"], labels: Int[Tensor, "v y x"]
) -> Float[Tensor, "v c y x"]:
    """Arrange the draws of the first view in every view so that clusters hold one draw each.

    A draw is never averaged, and none is used twice in a view: what was white noise inside a view
    stays so. As far as clusters are no more than cells, all views then hold the same draws in
    another order: what a model reads off the whole picture it reads alike in all of them, even
    where few cells correspond. Further clusters take draws of the other views.
    """
    cells = labels[0].numel()
    draws = noise.movedim(1, -1).reshape(-1, noise.shape[1])
    flat = labels.reshape(len(labels), cells)
    taken = _claims(flat)
    rows = []
    for view in flat:
        inside = view >= 0
        index = torch.arange(cells)
        index[inside] = taken[view[inside]]
        free = torch.ones(len(draws), dtype=torch.bool)
        free[index[inside]] = False
        keeps = ~inside & free[:cells]
        free[:cells] &= ~keeps
        moved = ~inside & ~keeps
        index[moved] = free.nonzero().squeeze(1)[: int(moved.sum())]
        rows.append(draws[index])
    return _as_grid(torch.cat(rows), noise)


def _claims(flat: Int[Tensor, "v n"]) -> Int[Tensor, " k"]:
    """The draw of each cluster, all different: that of its first cell's place, or the next free."""
    views, cells = flat.shape
    members = torch.nonzero(flat.reshape(-1) >= 0).squeeze(1)
    cluster = flat.reshape(-1)[members].long()
    count = int(cluster.max()) + 1 if len(members) else 0
    first = members.new_full((count,), views * cells).scatter_reduce(0, cluster, members, "amin")
    wanted = first % cells
    claimed = torch.full((cells,), count).scatter_reduce(0, wanted, torch.arange(count), "amin")
    wins = claimed[wanted] == torch.arange(count)
    free = torch.ones(views * cells, dtype=torch.bool)
    free[wanted] = False
    return torch.where(wins, wanted, 0).masked_scatter(~wins, free.nonzero().squeeze(1))


def _members(
    x: Float[Tensor, "v c y x"], labels: Int[Tensor, "v y x"]
) -> tuple[Float[Tensor, "vn c"], Int[Tensor, " m"], Int[Tensor, " m"], int]:
    """(all cells as rows, the rows that are in a cluster, their clusters, number of clusters)."""
    flat = labels.reshape(-1).long()
    rows = torch.nonzero(flat >= 0).squeeze(1)
    cluster = flat[rows]
    count = int(cluster.max()) + 1 if len(rows) else 0
    return x.permute(0, 2, 3, 1).reshape(-1, x.shape[1]), rows, cluster, count


def _as_grid(
    rows: Float[Tensor, "vn c"], like: Float[Tensor, "v c y x"]
) -> Float[Tensor, "v c y x"]:
    views, channels, height, width = like.shape
    return rows.reshape(views, height, width, channels).permute(0, 3, 1, 2).contiguous()
