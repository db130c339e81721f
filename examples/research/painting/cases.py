"""A scene that is painted, and the meters of a painted scene.

`n` Gaussians; `v` views of `h w` pixels, square ones of SIZE here; `m` matched points.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from gsedit.capture.matches import match_pictures
from gsedit.errors import InputError, UsageError
from gsedit.formats.scenes import load
from gsedit.measures.agreement import Matches, compare_points, matchable, spread
from gsedit.measures.formulas import psnr
from gsedit.measures.losses import gram
from gsedit.measures.perceptual import INSTALL, perceptual_distance, vgg_features
from gsedit.paper.editors.painter.editor import Painter
from gsedit.paper.editors.painter.network import SIDE, load_picture_styles, painted
from gsedit.paper.view_plan import plan_views, survey, wholeness
from gsedit.views.cameras_json import cameras_file, read_cameras
from gsedit.views.viewpoints import same_size, thinned
from gsedit.words.read import read_instruction
from rasterizer.camera import Camera
from rasterizer.render import render_picture
from rasterizer.scene import Gaussians

SIZE = 192
"""Pixels of the longer side of all pictures: what the painter paints at."""
HELD = 4
"""Cameras that are measured, of every eighth, which is never edited."""
NEAREST = 2
"""Cameras beside each measured one whose renders are compared with its own."""
BATCHES, EACH, OVERLAP = 6, 3, 0.5
"""The plan of views: so many batches of so many views, that overlap by so much."""
MATCHED_AT = 512
"""Pixels at which SIFT looks at the unedited scene: smaller pictures have too few points."""

Pictures = Mapping[int, Float[Tensor, "h w 3"]]


@dataclass(frozen=True, eq=False)
class Case:
    """A scene, its cameras by index, and what is found once for all arms."""

    name: str
    scene: Gaussians
    cameras: tuple[Camera, ...]
    views: tuple[int, ...]
    """Those that may be edited."""
    planned: tuple[int, ...]
    held: tuple[int, ...]
    weights: Float[Tensor, "v n"]
    """How much each camera sees of each Gaussian."""
    unedited: Pictures
    near: Matches
    """Points of pairs of near cameras, with a measured one in each."""
    among: Matches
    """Points of pairs of planned views."""
    sizes: Mapping[int, tuple[int, int]]
    """Sizes of the pictures that points have their positions in."""
    seconds: float
    """Processor seconds of the survey, the plan and the renders of planned views."""


@torch.no_grad()
def load_case(path: Path) -> Case:
    """The case of a scene file with its cameras beside it. Raises InputError without these."""
    file = cameras_file(path)
    if file is None:
        raise InputError(f"{path} has no cameras.json beside it: fit it by gsedit capture")
    scene = load(path)
    cameras = tuple(v.camera for v in same_size(thinned(read_cameras(file)), SIZE))
    views = tuple(i for i in range(len(cameras)) if i % 8 != 4)
    held = spread([i for i in range(len(cameras)) if i % 8 == 4], HELD)
    start = time.process_time()
    weights = survey(scene, cameras)
    own = [cameras[i] for i in views]
    seen = weights[list(views)]
    whole = wholeness(scene.means, own, seen)
    plan = plan_views(seen, EACH, BATCHES, 1.0, overlap=OVERLAP, whole=whole)
    planned = tuple(views[i] for i in plan.views)
    unedited = {i: render_picture(scene, cameras[i]) for i in planned}
    seconds = time.process_time() - start
    unedited |= {i: render_picture(scene, c) for i, c in enumerate(cameras) if i not in unedited}
    near = sorted({(min(i, j), max(i, j)) for i in held for j in _nearest(i, cameras)})
    among = matchable(planned, cameras)
    matches, sizes = _matches(scene, cameras, sorted({*near, *among}))
    return Case(
        path.stem, scene, cameras, views, planned, held, weights, unedited,
        {pair: matches[pair] for pair in near if pair in matches},
        {pair: matches[pair] for pair in among if pair in matches},
        sizes, seconds,
    )  # fmt: skip


def _nearest(i: int, cameras: Sequence[Camera]) -> list[int]:
    apart = [float((c.center - cameras[i].center).norm()) for c in cameras]
    return sorted(range(len(cameras)), key=apart.__getitem__)[1 : NEAREST + 1]


def _matches(
    scene: Gaussians, cameras: Sequence[Camera], pairs: Sequence[tuple[int, int]]
) -> tuple[Matches, dict[int, tuple[int, int]]]:
    """Points of the unedited scene by SIFT, and the sizes of the pictures they were found in."""
    large = {}
    for i in sorted({i for pair in pairs for i in pair}):
        scale = MATCHED_AT / max(cameras[i].width, cameras[i].height)
        sides = (round(cameras[i].width * scale), round(cameras[i].height * scale))
        large[i] = cameras[i].resized(*sides)
    pictures = {i: render_picture(scene, camera) for i, camera in large.items()}
    sizes = {i: (camera.width, camera.height) for i, camera in large.items()}
    return match_pictures(pictures, large, pairs), sizes


def energy(pictures: Sequence[Float[Tensor, "h w 3"]]) -> float:
    """Mean squared gradient: of strokes, and of whatever else has detail."""
    found = [
        (p[:, 1:] - p[:, :-1]).square().mean() + (p[1:] - p[:-1]).square().mean() for p in pictures
    ]
    return float(torch.stack(found).mean())


def disagreement(matches: Matches, case: Case, pictures: Pictures) -> float | None:
    """Difference of colors at matched points over that of the unedited scene; None for too few
    points."""
    found = compare_points(matches, case.unedited, pictures, case.sizes, "renders")
    return None if isinstance(found, str) else found.edited / found.unedited


class Meter:
    """The meters of a case in a style; the truth is what the network paints of each measured view
    alone."""

    @torch.no_grad()
    def __init__(self, case: Case, painter: Painter, style: str) -> None:
        distance = perceptual_distance()
        if distance is None:
            raise UsageError(f"the perceptual distance is not installed: {INSTALL}")
        self.case, self.distance = case, distance
        affine = painter.in_styles((read_instruction(style).changes[0].name,)).asked
        alone = [painted(painter.network, case.unedited[i][None], affine) for i in case.held]
        self.truth = torch.cat(alone)
        self.energy = energy(list(self.truth))
        self.grams, self.vector = _grams(self.truth), _vector(self.truth)

    @torch.no_grad()
    def __call__(self, scene: Gaussians) -> dict[str, float | None]:
        """All meters of a scene; of agreement None where too few points match."""
        case = self.case
        shown = {i for pair in case.near for i in pair} | {*case.held}
        renders = {i: render_picture(scene, case.cameras[i]) for i in sorted(shown)}
        held = torch.stack([renders[i] for i in case.held])
        off = [
            (a - b).norm(dim=(1, 2)) / b.norm(dim=(1, 2)) for a, b in zip(_grams(held), self.grams)
        ]
        return {
            "energy": energy(list(held)) / self.energy,
            "perceptual": float(self.distance(held, self.truth)),
            "gram": float(torch.stack(off).mean()),
            "likeness": float(torch.cosine_similarity(_vector(held), self.vector, dim=0)),
            "disagreement": disagreement(case.near, case, renders),
            "psnr": psnr(held, self.truth),
        }


def _grams(pictures: Float[Tensor, "v h w 3"]) -> list[Float[Tensor, "v _c _c"]]:
    """Gram matrices of VGG's features, which no loss here uses."""
    return [gram(each) for each in vgg_features()(pictures.movedim(-1, 1))]


def _vector(pictures: Float[Tensor, "v h w 3"]) -> Float[Tensor, "100"]:
    """The style predictor's vector of pictures, in the mean."""
    square = F.interpolate(pictures.movedim(-1, 1), (SIDE, SIDE), mode="bilinear", antialias=True)
    return load_picture_styles()[1](square.clamp(0, 1)).mean(0)
