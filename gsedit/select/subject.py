"""The subject of a scene: its objects that stand out in pictures of it.

Geometry tells objects apart, and saliency which of them the pictures are about: that of a published
network, U2-Net-p (Qin et al. 2020) with its weights. Where geometry cannot tell, as in a capture
from one side, the saliency alone decides. `n` Gaussians, `v` views of `h w` pixels.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Bool, Float
from scipy.spatial import ConvexHull, QhullError
from torch import Tensor, nn
from torch.nn.functional import interpolate, max_pool2d

from gsedit.errors import InputError
from gsedit.scene.cache import cached_per_scene
from gsedit.scene.framing import weighted_quantile
from gsedit.scene.neighbors import linked
from gsedit.select.layers import numbered
from gsedit.select.region import Lifted, Region, everything, lift, within_silhouette
from gsedit.select.segment import Segments, segment_surfaces
from gsedit.select.surfaces import Surfaces, look
from gsedit.views.around import cameras_of
from gsedit.views.dataset import evenly_spaced
from rasterizer.camera import Camera
from rasterizer.render import render
from rasterizer.scene import Gaussians

WIDTH, INNER = 64, 16
"""Channels between the blocks, and within them."""
DILATIONS = (1, 2, 4, 8)
"""Distances between the taps of the convolutions of a block that keeps its size."""


def _conv(inputs: int, outputs: int, dilation: int = 1) -> nn.Conv2d:
    return nn.Conv2d(inputs, outputs, 3, padding=dilation, dilation=dilation)


def _resized(x: Float[Tensor, "v c h w"], like: Tensor) -> Float[Tensor, "v c i j"]:
    return interpolate(x, like.shape[-2:], mode="bilinear", align_corners=False)


class Block(nn.Module):
    """A residual U-block: features at `depth` scales, halved from one to the next, and back up;
    `flat` ones dilate their convolutions instead."""

    def __init__(self, inputs: int, depth: int, *, flat: bool = False) -> None:
        super().__init__()
        self.flat = flat
        dilations = DILATIONS if flat else (*(1,) * (depth - 1), 2)
        sizes = (WIDTH, *(INNER,) * (depth - 1))
        self.first = _conv(inputs, WIDTH)
        self.down = nn.ModuleList(_conv(n, INNER, d) for n, d in zip(sizes, dilations, strict=True))
        outputs = (WIDTH, *(INNER,) * (depth - 2))
        back = dilations[:-1] if flat else (1,) * (depth - 1)
        self.up = nn.ModuleList(_conv(2 * INNER, n, d) for n, d in zip(outputs, back, strict=True))

    def forward(self, x: Float[Tensor, "v c h w"]) -> Float[Tensor, "v k h w"]:
        x = first = self.first(x).relu_()
        kept: list[Tensor] = []
        for i, conv in enumerate(self.down):
            halved = not self.flat and 0 < i < len(self.down) - 1
            x = conv(max_pool2d(x, 2, ceil_mode=True) if halved else x).relu_()
            kept.append(x)
        kept.pop()
        for conv in reversed(self.up):
            below = kept.pop()
            x = conv(torch.cat((_resized(x, below), below), 1)).relu_()
        return x + first


class U2Net(nn.Module):
    """Pictures to the probability that a pixel is of what stands out, 320x320 pixels at best."""

    def __init__(self) -> None:
        super().__init__()
        shapes: Sequence[tuple[int, bool]] = (
            (7, False), (6, False), (5, False), (4, False), (4, True), (4, True),
        )  # fmt: skip
        inputs = (3, *(WIDTH,) * 5)
        self.down = nn.ModuleList(
            Block(n, depth, flat=flat) for n, (depth, flat) in zip(inputs, shapes, strict=True)
        )
        self.up = nn.ModuleList(Block(2 * WIDTH, depth, flat=flat) for depth, flat in shapes[:5])
        self.sides = nn.ModuleList(_conv(WIDTH, 1) for _ in shapes)
        self.joined = nn.Conv2d(len(shapes), 1, 1)

    def forward(self, x: Float[Tensor, "v 3 h w"]) -> Float[Tensor, "v h w"]:
        """Return the probabilities for normalised pictures."""
        kept: list[Tensor] = []
        for i, block in enumerate(self.down):
            x = block(max_pool2d(x, 2, ceil_mode=True) if i else x)
            kept.append(x)
        features = [kept.pop()]
        for block in reversed(self.up):
            below = kept.pop()
            features.append(block(torch.cat((_resized(features[-1], below), below), 1)))
        sides = [conv(each) for conv, each in zip(self.sides, reversed(features), strict=True)]
        maps = [sides[0], *(_resized(each, sides[0]) for each in sides[1:])]
        return self.joined(torch.cat(maps, 1)).sigmoid()[:, 0]


WEIGHTS = Path(__file__).with_name("u2net.safetensors")
SIDE = 320
"""Sides of the square that the network looks at, pixels: it was trained on these."""
MEAN, DEVIATION = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
"""Mean and deviation of the colors of its training pictures: red, green, blue."""


@torch.no_grad()
def salient(pictures: Float[Tensor, "v h w 3"]) -> Float[Tensor, "v h w"]:
    """The probability that each pixel is of what stands out in its picture, in [0, 1].

    Pictures are sRGB in [0, 1]. Raises InputError for weights that are missing or damaged.
    """
    network = load_network()
    size = pictures.shape[1:3]
    x = pictures.float().permute(0, 3, 1, 2)
    x = interpolate(x, (SIDE, SIDE), mode="bilinear", antialias=True).clamp(0, 1)
    x = x / x.amax((1, 2, 3), keepdim=True).clamp_min(1e-6)
    x = (x - x.new_tensor(MEAN)[:, None, None]) / x.new_tensor(DEVIATION)[:, None, None]
    x = x.contiguous(memory_format=torch.channels_last)  # a third quicker on AVX-512
    maps = torch.cat([network(each[None]) for each in x])[:, None]
    return interpolate(maps, size, mode="bilinear", antialias=True)[:, 0].clamp(0, 1)


def load_network(path: Path = WEIGHTS) -> U2Net:
    """The network with the weights of a file, kept until the file changes.

    Raises InputError for a file that is missing, damaged or of another network.
    """
    try:
        return _load(path, path.stat().st_mtime_ns)
    except Exception as error:  # safetensors and torch raise their own, without a common base
        reason = next(iter(str(error).strip().splitlines()), type(error).__name__)
        raise InputError(
            f"{path} does not hold the weights that find the subject ({reason}): install gsedit "
            "again, or name the part with --at, --phrase or --region"
        ) from error


@lru_cache(maxsize=1)
def _load(path: Path, modified_ns: int) -> U2Net:
    from safetensors.torch import load_file

    with torch.random.fork_rng():  # initial weights would take numbers from the global generator
        network = U2Net()
    network.load_state_dict(load_file(path))
    as_last = nn.utils.convert_conv2d_weight_memory_format
    return as_last(network.eval().requires_grad_(False), torch.channels_last)


VIEWS = 8
"""Most views in which the subject is searched. On six fits of three captures, 16 change its IoU
with masks drawn by hand by at most 0.004, and take 1.6 times as long."""
LEAST_VOTE, OF_BEST = 0.25, 0.5
"""Least mean saliency of a segment that stands out, and least share of the largest one's."""
LIFTED_SHARE, TOP = 0.45, 0.95
"""Threshold where saliency alone decides, of the quantile TOP of what stands out."""
LEAST_PIXELS = 0.002
"""Least share of what is seen that is a subject."""
FAINT, BESIDE, LEAST_SKIRT = 0.5, 0.3, 0.03
"""A piece of a segment is of the ground where its saliency is below FAINT of the segment's median,
a share BESIDE of it is next to the ground, and it has LEAST_SKIRT of the segment's Gaussians."""
CARRIED = 0.5
"""Least part of what is seen of a carrier that must be seen of what stands on it, for the carrier
to be no part of the subject: a plinth is none, a table under a vase is."""
ALONE = 0.75
"""Least share of all that is seen which the subject of a scene without surroundings fills."""


Saliency = Callable[[Float[Tensor, "v h w 3"]], Float[Tensor, "v h w"]]
"""A map from pictures to the probability that a pixel is of what stands out."""


@dataclass(frozen=True, eq=False)
class _Looked:
    """Saliency, surfaces and segments of a scene, from one look at it."""

    cameras: tuple[Camera, ...]
    lifted: Lifted
    border: float
    surfaces: Surfaces
    segments: Segments
    """Segments of the surfaces, which are groups of a large scene."""


def find_subject(
    scene: Gaussians,
    cameras: Sequence[Camera] = (),
    *,
    with_carrier: bool = False,
    saliency: Saliency = salient,
) -> Region:
    """Find what the pictures of a scene are about: everything where nothing stands out.

    What the subject stands on, as a plinth or a rock, is left out unless `with_carrier`. `saliency`
    finds what stands out in pictures. Without cameras, some are found. Raises UsageError for an
    empty scene, InputError where the network's weights are missing or damaged.
    """
    looked = _look(scene.detach(), tuple(cameras), saliency)
    inside, note = _standing_out(looked, with_carrier=with_carrier)
    weight, every = looked.lifted.weight, everything(scene)
    if inside is None or weight[inside].sum() < LEAST_PIXELS * weight.sum():
        return replace(every, note="auto: no subject stands out, so it is all", sure=0.0)
    if weight[inside].sum() > ALONE * weight.sum() and looked.border < 0.1:  # opacity
        return replace(every, note="auto: the subject, with nothing around it")
    sure = float((looked.lifted.mean * weight)[inside].sum() / weight[inside].sum())
    return Region(within_silhouette(scene, looked.cameras, inside), note, sure=sure)


@cached_per_scene
@torch.no_grad()
def _look(scene: Gaussians, cameras: tuple[Camera, ...], saliency: Saliency) -> _Looked:
    every = cameras_of(scene, cameras, VIEWS, SIDE)
    some = tuple(every[i].fitted(SIDE) for i in evenly_spaced(len(every), VIEWS))
    # with median depth, as every other render of the unedited scene: equal to the last bit
    renders = [render(scene, camera, median_depth=True) for camera in some]
    maps = [saliency(each.color.clamp(0, 1)[None])[0] for each in renders]
    surfaces = look(scene, every)
    return _Looked(
        some,
        lift(scene, some, maps),
        border_opacity([each.alpha for each in renders]),
        surfaces,
        segment_surfaces(surfaces),
    )


def _standing_out(looked: _Looked, *, with_carrier: bool) -> tuple[Bool[Tensor, " n"] | None, str]:
    """The Gaussians that stand out, and how they were found; None where nothing does."""
    mean, weight = looked.lifted.mean, looked.lifted.weight
    sure = mean > 0.5  # it stands out by itself
    count, labels = len(looked.segments.rows), looked.surfaces.expanded(looked.segments.labels)
    total = torch.bincount(labels, weight.double(), minlength=count).clamp_min(1e-9)
    means = (torch.bincount(labels, (weight * mean).double(), minlength=count) / total).tolist()
    votes = {row.number: means[row.number] for row in looked.segments.objects}
    best = max(votes.values(), default=0.0)
    chosen = [i for i, vote in votes.items() if vote >= max(LEAST_VOTE, OF_BEST * best)]
    inside = torch.isin(labels, torch.tensor(chosen, dtype=torch.long))
    held = float(weight[sure & inside].sum() / weight[sure].sum().clamp_min(1e-9))
    # segments decide where they hold what stands out by itself
    if chosen and (held >= 0.75 or not sure.any()):
        rows = looked.segments.rows
        if with_carrier:
            under = {rows[i].stands_on for i in chosen}
            chosen += [row.number for row in looked.segments.objects if row.number in under]
        else:
            on = [row for row in map(rows.__getitem__, chosen) if row.stands_on in chosen]
            apart = {r.stands_on for r in on if r.pixels >= CARRIED * rows[r.stands_on].pixels}
            chosen = [i for i in chosen if i not in apart]
        return _outlined(looked, chosen, with_carrier=with_carrier), "auto: the subject"
    if float(weight[sure].sum()) < LEAST_PIXELS * float(weight.sum()):
        return None, ""
    top = float(weighted_quantile(mean[sure][:, None].double(), weight[sure].double(), TOP))
    return mean > LIFTED_SHARE * top, "auto: what stands out in pictures"


def _outlined(looked: _Looked, chosen: Sequence[int], *, with_carrier: bool) -> Bool[Tensor, " n"]:
    """The chosen segments without a skirt of the ground and, unless it is asked for, without the
    block that they stand on."""
    surfaces = looked.surfaces
    inside = looked.segments.inside(*chosen).numpy()
    inside = inside & ~_skirt(looked, inside)
    if not with_carrier:
        inside = inside & ~block_under(surfaces, inside)
    return surfaces.expanded(torch.from_numpy(inside))


def _skirt(looked: _Looked, inside: Bool[np.ndarray, " m"]) -> Bool[np.ndarray, " m"]:
    """Flag faint pieces that lie along the ground, as the side of a slab that is of the ground."""
    surfaces, kinds = looked.surfaces, [row.kind for row in looked.segments.rows]
    ground = np.array([kind == "ground" for kind in kinds])[looked.segments.labels.numpy()]
    mean = _grouped_mean(looked)
    if not inside.any() or not ground.any():
        return np.zeros_like(inside)
    faint = inside & surfaces.solid & (mean < FAINT * np.median(mean[inside]))
    both = faint[surfaces.edges].all(1)
    piece = numbered(linked(surfaces.edges[both], len(surfaces)), faint)
    beside = surfaces.touches(inside, ground) > 0
    size = np.bincount(piece[faint], minlength=1)
    touching = np.bincount(piece[faint], weights=beside[faint], minlength=1)
    large = size >= LEAST_SKIRT * inside.sum()
    return faint & np.isin(piece, np.flatnonzero(large & (touching >= BESIDE * size)))


def _grouped_mean(looked: _Looked) -> Float[np.ndarray, " m"]:
    """The lifted saliency of the surfaces: of groups, weighted by what is seen."""
    mean, weight = looked.lifted.mean.double(), looked.lifted.weight.double()
    merged = looked.surfaces.merged
    if merged is None:
        return mean.numpy()
    group = merged.group.long()
    total = torch.bincount(group, weight, minlength=len(looked.surfaces)).clamp_min(1e-9)
    return (torch.bincount(group, weight * mean, minlength=len(looked.surfaces)) / total).numpy()


def border_opacity(alphas: Sequence[Float[Tensor, "h w"]]) -> float:
    """The mean opacity along the borders of pictures: near 0 for an object on nothing."""
    sides = [side for a in alphas for side in (a[0], a[-1], a[:, 0], a[:, -1])]
    return float(torch.cat(sides).mean())


SLICES, FINER = 24, 4
"""Level slices of a thing, and parts of the two of them in which the top of its block lies."""
TALL, LOW = 0.1, 0.45
"""Least and largest height of a block that it stands on, of the height of both."""
NARROW, OF_TOP = 0.5, 0.75
"""Largest girth of the thing where it stands on the block, of the block's; and the least girth of
what is still the block, of the largest near its top: a level top has most surface a height."""
LEAST_SLICE = 16
"""Least Gaussians of a slice that tells a girth."""


def block_under(surfaces: Surfaces, inside: Bool[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
    """Flag the block that the thing inside stands on and is narrower than, as a rock; none if
    there is no such block. `inside` holds both."""
    none = np.zeros_like(inside)
    if inside.sum() < SLICES * LEAST_SLICE:
        return none
    heights = surfaces.heights
    low, high = np.quantile(heights[inside], (0.01, 0.99))
    edges = np.linspace(low, high, SLICES + 1)
    girths = [_girth(surfaces, inside, *pair) for pair in pairwise(edges)]
    for i in range(round(TALL * SLICES), round(LOW * SLICES)):
        girth = np.median([girths[j][0] for j in range(i)])
        hull = np.median([girths[j][1] for j in range(i)])
        after = min(each[0] for each in girths[i : i + 2])
        # feet and legs apart fill less of the hull around them
        if girth < 0.8 * hull or girths[i - 1][0] < NARROW * girth or after > NARROW * girth:
            continue
        fine = np.linspace(edges[i - 1], edges[i + 1], 2 * FINER + 1)
        around = np.array([_girth(surfaces, inside, *pair)[0] for pair in pairwise(fine)])
        top = np.flatnonzero(around >= OF_TOP * around.max())[-1]
        block = inside & (heights < fine[top + 1])
        seen = surfaces.seen[inside].sum()
        if surfaces.seen[inside & ~block].sum() >= 0.7 * seen:  # the thing is above the block
            return block
    return none


def _girth(
    surfaces: Surfaces, inside: Bool[np.ndarray, " n"], low: float, high: float
) -> tuple[float, float]:
    """Length of the surface around a level slice, and of the hull around it."""
    rows = np.flatnonzero(inside & (surfaces.heights >= low) & (surfaces.heights < high))
    if len(rows) < LEAST_SLICE:
        return 0.0, 0.0
    length = float(surfaces.areas[rows].sum()) / max(high - low, 1e-12)
    front = surfaces.place.front.numpy()
    flat = surfaces.points[rows] @ np.stack((front, np.cross(surfaces.up, front)), 1)
    try:
        return length, float(ConvexHull(flat).area)  # of a hull in a plane, that is its outline
    except QhullError:
        return length, 0.0
