"""Framing a scene without cameras: its bulk, its upward direction, a camera that shows it.

`n` Gaussians; positions in world units."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import radians, sin

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.errors import UsageError
from gsedit.scene.quaternions import AXES, even_directions
from rasterizer.camera import Camera, look_at
from rasterizer.scene import Gaussians

GROUND_SHARE = 0.22  # of the centers near the middle: fewer in one layer are no ground
ABOVE_SHARE = 0.2  # fewer above the layer: the layer may be a wall or a ceiling
NEAR_SHARE = 0.005
"""Near plane of a camera that is made for a scene, in radii of its bulk: 0.01 at a radius of 2."""
MAX_BELOW = 0.2  # of those above: more below, and the layer is no ground either


@dataclass(frozen=True)
class Bounds:
    """The ball that holds the bulk of a scene, world units; far-away splats do not count."""

    center: tuple[float, float, float]
    radius: float

    @property
    def near(self) -> float:
        """Near plane of a camera that is made for the scene, world units."""
        return NEAR_SHARE * self.radius


def bounds(scene: Gaussians, *, alone: bool = False) -> Bounds:
    """Center and radius that hold nearly all of an object, or the dense middle of a capture.

    Which of the two it is, is read off the distances of the centers, unless it is known to be an
    object `alone`. Only the more opaque half counts. Raises UsageError for an empty scene.
    """
    if not len(scene):
        raise UsageError("the scene has no Gaussians: there is nothing to frame")
    opacities = scene.opacities.detach()
    opaque = (opacities >= opacities.median()).nonzero().squeeze(-1)
    means = scene.means.detach()[opaque].double()
    center = means.median(0).values
    extent, half, most = _distances(means, center)
    if alone or most <= 3 * half:  # an object alone, not a capture, most of which is surroundings
        ordered = means.sort(0).values
        low, high = (ordered[int(f * (len(means) - 1))] for f in (0.03, 0.97))
        center = (low + high) / 2
        extent = 1.15 * _distances(means, center)[2]  # includes the parts that stand out
    x, y, z = center.tolist()
    longest = scene.log_scales.detach()[opaque].amax(-1).median().double().exp()
    splat = 3 * float(longest)  # splats reach beyond their centers
    return Bounds((x, y, z), extent + splat or 1.0)  # points at one place have no size


def _distances(points: Float[Tensor, "n 3"], center: Float[Tensor, "3"]) -> tuple[float, ...]:
    """The radii around the center within which 30 %, 50 % and 95 % of the points lie."""
    distance = (points - center).norm(dim=-1).sort().values
    return tuple(float(distance[int(f * (len(distance) - 1))]) for f in (0.3, 0.5, 0.95))


def guess_up(scene: Gaussians) -> Float[Tensor, "3"]:
    """The upward unit normal of the ground that the scene stands on, float64, or INRIA's -y where
    there is no clear ground.

    The axes of a capture are seldom level. Of 400 directions, this takes the one along which the
    nearest 40 % of the centers are most concentrated in one of 32 layers. That layer is the ground
    where it holds much, much lies on one side of it and little on the other; the thresholds were
    chosen on two captures with a ground and three without.
    """
    if not len(scene):
        return up_vector("-y")
    near = scene.means.detach().double()
    near = near - near.median(0).values
    distance = near.norm(dim=1)
    radius = distance.sort().values[int(0.4 * (len(near) - 1))]
    near = near[distance <= radius] / radius.clamp_min(1e-12)
    near = near[:: 1 + len(near) // 20_000]  # enough to find a plane
    directions = torch.tensor(even_directions(800)[:400])  # the upper hemisphere
    layers = torch.stack([torch.histc(height, 32, -1, 1) for height in directions @ near.T])
    best = int(layers.amax(1).argmax())
    shares = layers[best] / layers[best].sum()
    ground = int(shares.argmax())
    ahead, behind = float(shares[ground + 2 :].sum()), float(shares[: max(ground - 1, 0)].sum())
    above, below = max(ahead, behind), min(ahead, behind)
    if shares[ground] < GROUND_SHARE or above < ABOVE_SHARE or below > MAX_BELOW * above:
        return up_vector("-y")
    return directions[best] if ahead > behind else -directions[best]


def up_vector(axis: str) -> Float[Tensor, "3"]:
    """The unit vector, float64, of an axis name: x, -x, y, -y, z or -z; otherwise UsageError."""
    if axis not in AXES:
        raise UsageError(f"up axis '{axis}': use one of x, -x, y, -y, z, -z")
    return torch.from_numpy(AXES[axis]).clone()


def framing_camera(
    scene: Gaussians,
    *,
    up: Float[Tensor, "3"] | None = None,
    eye: Float[Tensor, "3"] | None = None,
    target: Float[Tensor, "3"] | None = None,
    size: tuple[int, int] = (960, 720),
) -> Camera:
    """A camera that shows the bulk of a scene from a little above; `size` is (width, height).

    The ball of `bounds` fills the picture; `up` is a unit vector, guessed if None. `target` stands
    for the middle of the ball, and `eye` is where the camera stands. Raises UsageError for an empty
    scene, or an eye that is the target.
    """
    width, height = size
    bulk = bounds(scene)
    up = guess_up(scene) if up is None else up
    # COLMAP's cameras look along +z, nerfstudio's (z up) stand at -y: 30 degrees from there
    front = -torch.eye(3, dtype=torch.float64)[1 if up[2].abs() > 0.7 else 2]
    side = torch.nn.functional.normalize(torch.linalg.cross(front, up), dim=0)
    direction = 0.87 * torch.linalg.cross(up, side) + 0.5 * side + 0.4 * up
    fov_y = 50.0
    narrower = radians(fov_y) / 2 * min(1.0, width / height)
    distance = bulk.radius / sin(narrower)
    center = torch.tensor(bulk.center, dtype=torch.float64) if target is None else target
    eye = center + distance * direction / direction.norm() if eye is None else eye
    if torch.equal(eye, center):
        raise UsageError(f"the camera stands where it looks, at {eye.tolist()}: move one of them")
    camera = look_at(eye, center, up, fov_y, width, height)
    return replace(camera, near=bulk.near)


def finest_pixels(means: Float[Tensor, "n 3"], cameras: Sequence[Camera]) -> Float[Tensor, " n"]:
    """Width of a pixel at each Gaussian in the camera that shows it largest, world units.

    0 where no camera has it in its picture, with a margin of a tenth on each side.
    """
    finest = torch.full_like(means[:, 0], torch.inf)
    for camera in cameras:
        places, depth = camera.project(means)
        size = places.new_tensor((camera.width, camera.height))
        seen = (depth > 0) & ((places / size - 0.5).abs().amax(-1) < 0.6)
        width = (depth if camera.model == "pinhole" else 1.0) / camera.fx
        finest = torch.where(seen, finest.clamp_max(width), finest)
    return finest.nan_to_num(posinf=0.0)


def weighted_quantile(
    values: Float[Tensor, "n c"], weights: Float[Tensor, " n"], share: float
) -> Float[Tensor, " c"]:
    """The least value of each column up to which a share in [0, 1] of the weight lies.

    There is at least one value; without any weight it is the largest.
    """
    ordered, order = values.sort(0)
    below = weights[order].cumsum(0) / weights.sum().clamp_min(1e-12)
    at = (below < share).sum(0).clamp_max(len(values) - 1)
    return ordered.gather(0, at[None])[0]


def ends(values: Float[Tensor, "n d"], tail: float) -> Float[Tensor, "2 d"]:
    """Begin and end of each column without a share of the values beyond either: stray ones."""
    last = len(values) - 1
    return values.sort(0).values[[int(tail * last), int((1 - tail) * last)]]
