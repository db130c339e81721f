"""Gaussians that fill the hole of a sheet.

Where its texture was copied, the Gaussians are copied that made it, so that they have its grain,
roughness and view dependence; under them, and elsewhere, lies a layer of flat discs.
`n` Gaussians; a sheet of `h w` cells; `k` harmonics a channel.
"""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float, Float64
from scipy.ndimage import binary_dilation, distance_transform_edt, gaussian_filter

from gsedit.objects.removal.complete import Completed, complete
from gsedit.objects.removal.draw import Draw, drawn_over
from gsedit.objects.removal.membrane import solve_membrane
from gsedit.objects.removal.sheet import Sheet
from gsedit.objects.removal.walls import Plane
from gsedit.scene.quaternions import quaternion_of, turn_between
from rasterizer.numerics import SH_DC
from rasterizer.scene import Gaussians, concatenate

DISC, FLATNESS, OPACITY = 0.7, 0.1, 0.985
"""Standard deviation of a disc in cells, its thickness against it, and its opacity: neighbors
leave no gaps (gsedit.synthetic.splats)."""
SINK = 0.5
"""Depth of the discs under the plane, in bands, where copies lie over them."""
REACH = 2.0
"""Standard deviations to which a copy reaches: it must not stand over the edge of its surface."""
SMOOTHED = 0.1
"""Standard deviation over which view dependence is averaged, of the hole's size."""


def filled(
    kept: Gaussians, sheet: Sheet, plane: Plane, draw: Draw | None = None
) -> tuple[Gaussians, bool]:
    """The Gaussians of a sheet's hole, and whether they have texture.

    `kept` is what is left of the scene; `draw` makes up the texture instead.
    """
    done = complete(sheet.values[..., :3], sheet.known, sheet.hole)
    if draw is not None:
        picture = drawn_over(done.picture, sheet.known, sheet.hole, draw)
        return _discs(sheet, plane, picture, 0.0, kept), True
    copies = _copies(kept, sheet, plane, done)
    sink = SINK * plane.band if len(copies) else 0.0
    return concatenate(copies, _discs(sheet, plane, done.picture, sink, kept)), done.textured


def _copies(kept: Gaussians, sheet: Sheet, plane: Plane, done: Completed) -> Gaussians:
    """The plane's Gaussians, copied along the shifts of the hole's cells, in its light."""
    rows = torch.from_numpy(
        np.flatnonzero(plane.on(kept.means.numpy()) & (sheet.at(kept.means.numpy()) >= 0))
    )
    cells = sheet.at(kept.means[rows].numpy())
    flat = sheet.known.reshape(-1)[cells]
    rows, cells = rows[torch.from_numpy(flat)], cells[flat]
    order = np.argsort(cells, kind="stable")
    rows, cells = rows[torch.from_numpy(order)], cells[order]
    w = sheet.hole.shape[1]
    target = np.flatnonzero(sheet.hole.reshape(-1))
    source = (done.source[..., 0] * w + done.source[..., 1]).reshape(-1)[target]
    if not done.textured:
        target, source = target[:0], source[:0]
    first, last = np.searchsorted(cells, source), np.searchsorted(cells, source, "right")
    counts = last - first
    which = np.repeat(np.arange(len(target)), counts)
    nth = np.arange(counts.sum()) - np.repeat(counts.cumsum() - counts, counts)
    taken = first[which] + nth
    target, source = target[which], source[which]
    inner = distance_transform_edt(np.pad(sheet.hole | sheet.known, 1))[1:-1, 1:-1] * sheet.cell
    scene = kept[rows[torch.from_numpy(taken)]]
    fits = torch.from_numpy(
        REACH * scene.scales.amax(1).numpy() < inner.reshape(-1)[target] + sheet.cell
    )
    scene, target, source = scene[fits], target[fits.numpy()], source[fits.numpy()]
    places = torch.from_numpy(sheet.points())
    means = scene.means + (places[target] - places[source]).to(scene.means)
    color = done.picture.reshape(-1, 3)
    light = torch.from_numpy(color[target] - color[source]).to(scene.sh) / SH_DC
    sh = torch.cat((scene.sh[:, :1] + light[:, None], scene.sh[:, 1:]), 1)
    return Gaussians(means, scene.quats, scene.log_scales, scene.logit_opacities, sh)


def _discs(
    sheet: Sheet,
    plane: Plane,
    picture: Float[np.ndarray, "h w 3"],
    sink: float,
    like: Gaussians,
) -> Gaussians:
    """A layer of discs, one a cell, under the plane by `sink` world units."""
    at = sheet.hole.reshape(-1)
    points = torch.from_numpy(sheet.points()[at] - sink * plane.normal)
    count = len(points)
    bands = _bands(sheet)[sheet.hole]
    own = (picture[sheet.hole] - 0.5) / SH_DC - np.einsum("pkc,k->pc", bands, sheet.usual[1:])
    sh = torch.from_numpy(np.concatenate((own[:, None], bands), 1))
    size = torch.tensor((DISC, DISC, DISC * FLATNESS)).double() * sheet.cell
    turn = quaternion_of(turn_between(np.array((0.0, 0.0, 1.0)), plane.normal))
    opacity = torch.full((count,), OPACITY).double().logit()
    made = Gaussians(
        points,
        torch.from_numpy(turn).expand(count, 4).contiguous(),
        size.log().expand(count, 3).contiguous(),
        opacity,
        sh,
    )
    return made.to(like.means.dtype)


def _bands(sheet: Sheet) -> Float64[np.ndarray, "h w k 3"]:
    """Harmonics above the first: those of what is known around, smooth."""
    bands = sheet.values[..., 3:]
    shape = (*sheet.hole.shape, bands.shape[-1] // 3, 3)
    if not bands.shape[-1] or not sheet.known.any():
        return np.zeros(shape)
    sigma = SMOOTHED * np.sqrt(sheet.hole.sum())
    share = gaussian_filter(sheet.known.astype(float), sigma)[..., None]
    mean = gaussian_filter(np.where(sheet.known[..., None], bands, 0), (sigma, sigma, 0))
    rim = sheet.known & binary_dilation(sheet.hole, iterations=2)
    return solve_membrane(mean / np.maximum(share, 1e-6), ~rim, rim).reshape(shape)
