"""Views of a scene that came without cameras, from where it looks as if it was captured: judged by
small renders, level, few; and renders from them. `n` Gaussians.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import radians, tau

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.errors import UsageError
from gsedit.scene.framing import bounds, guess_up
from gsedit.scene.merging import coarsen
from gsedit.views.dataset import Dataset
from gsedit.views.normals import normals_of_depth
from gsedit.views.orbit import ELEVATION, Vector, orbit, perpendicular, towards, unit_up
from gsedit.views.search import (
    BLUR,
    BLURRED,
    EFFORT,
    FOV,
    OPAQUE,
    Places,
    Sample,
    SearchEffort,
    ViewConstraints,
    cones,
    directions_around,
    draw_sample,
    find_places,
    panorama,
    score_panorama,
)
from gsedit.views.viewpoints import Viewpoint, rendered
from rasterizer.camera import Camera, look_at
from rasterizer.numerics import SH_DC
from rasterizer.render import render
from rasterizer.scene import Gaussians

FOUND_VIEWS = 24
"""Views that are found for a scene without cameras."""
FOUND_SIZE_PIXELS = 256
"""Side of the pictures of found views, which are square."""


def around(
    scene: Gaussians,
    size: int = FOUND_SIZE_PIXELS,
    up: Vector | None = None,
    *,
    look_at: Vector | None = None,
    eye: Vector | None = None,
) -> Dataset:
    """Render a scene, `size` pixels square, from where it looks as if it was captured.

    `up` (any length), the point `look_at` that views look at and the point `eye` that they are
    taken from are found where they are None (docs/reference/cameras.md). World axes.
    Raises UsageError for an `up` of no direction, or an empty scene.
    """
    wish = ViewConstraints(None if up is None else unit_up(up), look_at, eye)
    return rendered(scene, find_viewpoints(scene, size=size, wish=wish))


def find_viewpoints(
    scene: Gaussians,
    count: int = FOUND_VIEWS,
    size: int = FOUND_SIZE_PIXELS,
    *,
    wish: ViewConstraints | None = None,
    rings: Sequence[float] = (ELEVATION,),
) -> tuple[Viewpoint, ...]:
    """Find at most `count` viewpoints from which the scene looks as if it was captured.

    Pictures are `size` pixels square. A merged copy of a large scene is searched instead of it.
    Around an object alone they have the elevations `rings`, degrees.
    Raises UsageError for an empty scene.
    """
    if not len(scene):
        raise UsageError("the scene is empty: there is nothing to see")
    merged = coarsen(scene)
    searched = scene if merged is None else merged.scene
    cameras = find_views(searched, count, size, wish=wish, rings=rings)
    return tuple(Viewpoint(f"view_{i:03d}", each) for i, each in enumerate(cameras))


def cameras_of(
    scene: Gaussians,
    cameras: Sequence[Camera] = (),
    count: int = FOUND_VIEWS,
    size: int = FOUND_SIZE_PIXELS,
) -> Sequence[Camera]:
    """The cameras, or found ones where there are none: see `find_viewpoints`."""
    return cameras or [each.camera for each in find_viewpoints(scene, count, size)]


NARROW = 0.96
"""Cosine (16 degrees) within which a surface's normal counts for a direction."""


def find_up(
    directions: Float[Tensor, "d 3"],
    normals: Float[Tensor, "n 3"],
    forwards: Float[Tensor, "v 3"] | None = None,
) -> Vector | None:
    """The upward unit vector, float64; None where nothing says.

    Of `directions`, the one that most of the surfaces in view face, while the views (if given) look
    across it: cameras are held level, so that a wall, which one view faces, is one that others look
    along. Twice the mean square of forward . up is 1 for a wall's normal in a room.
    """
    if not len(normals):
        return None
    facing = ((normals @ directions.T) > NARROW).double().mean(0)
    score = facing
    if forwards is not None:
        score = facing * (1 - 2 * (forwards @ directions.T).square().mean(0)).clamp_min(0)
    best = int(score.argmax())
    if float(facing[best]) < 0.06 or float(score[best]) <= 0:
        return None
    near = normals[(normals @ directions[best]) > NARROW]
    return torch.nn.functional.normalize(near.mean(0), dim=0)


SMALL = 48
"""Side of the renders that judge a view, pixels."""
SPREAD = 4.0
"""Weight of the spread of depths in the score of a render (OPAQUE, BLUR: gsedit.views.search)."""
SURROUNDED = 0.5
"""Least share of all directions that are opaque from the places of a capture with surroundings: an
object alone hides at most half of them from a place outside it."""
ADMITTED = 1.0
"""A view is admitted whose score is at most this far below the best one's."""
CORE = 2.6
"""Radius of a ring in the distances within which a quarter of all Gaussians lie: 2.4 to 2.7 in
seven fits of three captures."""
ONE_SIDED = 0.6
"""How much better the views from above the ground are at least: 1.1 to 3.2 in these fits, at most
0.3 around three rooms."""
STEPS = ((15.0, 1.0), (30.0, 1.0), (45.0, 1.0), (25.0, 0.75))
"""Elevations, degrees, and distances, in radii of the ring, in the order in which they are liked;
the later half of the views, between the others, does without the first."""
AS_CLEAR, HAZE = 0.5, 0.25
"""How much less clear than the best of its steps a view may be; and the near plane on a ring, in
its radii: floaters hang about where cameras were."""


@dataclass(frozen=True, eq=False)
class ScoredView:
    """A view with its score, and what a small render of it shows."""

    camera: Camera
    score: float
    clear: float
    """The score without the number of Gaussians a pixel: 4 is opaque, and all in one place."""
    weights: Float[Tensor, " n"]
    """How much of each Gaussian, in pixels."""
    depth: Float[Tensor, "h w"]
    """Median depth along the view."""


def find_views(
    scene: Gaussians,
    count: int,
    size: int,
    *,
    wish: ViewConstraints | None = None,
    rings: Sequence[float] = (ELEVATION,),
    effort: SearchEffort = EFFORT,
) -> tuple[Camera, ...]:
    """At most `count` views of `size`^2 pixels from where a scene looks as if it was captured.

    They differ, are level, and show well what good views show, once or more; around an object
    without surroundings they are an `orbit` at each of the elevations `rings` (degrees). The same
    scene gives the same views. Raises UsageError for an eye that is the point to look at.
    """
    generator, wish = torch.Generator().manual_seed(0), wish or ViewConstraints()
    if wish.eye is not None and wish.look_at is not None and not (wish.eye - wish.look_at).any():
        raise UsageError(f"views cannot stand at {wish.eye.tolist()} and look at it: move one")
    scene = scene.detach()
    free, ball = wish.eye is None and wish.look_at is None, bounds(scene)
    apart = (scene.means - scene.means.median(0).values).norm(dim=-1).median()
    if free and apart <= scene.scales.amax(-1).median():  # no place among them to stand at
        return _orbits(scene, count, size, wish.up, rings)
    sample = draw_sample(scene, generator)
    if free and (ring := find_ring(scene, sample, wish.up)):
        return tuple(camera.resized(size, size) for camera in _on_ring(scene, ring, count))
    places = find_places(sample, wish, generator, effort)
    if free and places.enclosed < SURROUNDED:
        return _orbits(scene, count, size, wish.up, rings)
    judged = _judged(scene, places, wish, ball.near, effort)
    up = _up(scene, judged) if wish.up is None else wish.up
    chosen = [upright(judged[i].camera, up) for i in cover(judged, count)]
    if wish.eye is not None and wish.look_at is not None:  # the first view is the very one
        exact = look_at(wish.eye, wish.look_at, perpendicular(wish.look_at - wish.eye), FOV, 1, 1)
        chosen = [upright(exact, up), *chosen[1:]]
    return tuple(replace(camera.resized(size, size), near=ball.near) for camera in chosen)


def _orbits(
    scene: Gaussians, count: int, size: int, up: Vector | None, rings: Sequence[float]
) -> tuple[Camera, ...]:
    """An orbit at each elevation, `count` cameras in all."""
    each = max(1, count // len(rings))
    around = (orbit(scene, each, size, up=up, elevation=e, alone=True) for e in rings)
    return tuple(camera for ring in around for camera in ring)


@dataclass(frozen=True, eq=False)
class Ring:
    """A circle from which a subject and what is around it look as if they were captured."""

    middle: Vector
    """The place that its cameras look at, a little above the densest part; world units."""
    up: Vector
    radius: float

    def seen(self, scene: Gaussians, direction: Vector, distance: float = 1.0) -> ScoredView:
        """The view of the middle from a unit direction, at a distance in radii."""
        eye = self.middle + distance * self.radius * direction
        camera = look_at(eye, self.middle, self.up, FOV, SMALL, SMALL)
        return score_render(scene, replace(camera, near=HAZE * self.radius))


def find_ring(scene: Gaussians, sample: Sample, up: Vector | None = None) -> Ring | None:
    """The ring around the densest part of a scene; None where nothing is around that, as around an
    object alone, or where it looks no better from one side, as a room from outside.

    Above the ground things look sharp and closed, and from below they do not: the mean of all
    directions, weighted by the scores of the panoramas there, is about up. Up itself is then the
    direction that most surfaces face in good views from above.
    """
    means = scene.means.double()
    middle = means[scene.opacities >= scene.opacities.median()].median(0).values
    radius = CORE * float((means - middle).norm(dim=-1).sort().values[len(means) // 4])
    directions = directions_around(EFFORT.directions).double()
    views = [panorama(sample, middle + radius * each) for each in directions]
    scores = [score_panorama(view, mask[None]) for view, mask in zip(views, cones(-directions))]
    scores = torch.cat(scores).double()
    better = torch.nn.functional.normalize((scores - scores.mean()) @ directions, dim=0)
    rough = better if up is None else unit_up(up)
    height = directions @ rough
    above = ((height < 0.9) & (height > -0.1)).nonzero()[:, 0]
    best = above[scores[above].argsort(descending=True)[:FOUND_VIEWS]]
    enclosed = Places(directions[best], [views[i] for i in best.tolist()]).enclosed
    one_sided = float(scores[height > 0.2].mean() - scores[height < -0.2].mean())
    if not (enclosed >= SURROUNDED and one_sided >= ONE_SIDED):  # not a number: nothing is there
        return None
    ring = Ring(middle, rough, radius)
    if up is None:
        near = directions_around(1000).double()
        seen = (ring.seen(scene, directions[i]) for i in best)
        found = find_up(near[near @ rough > 0.5], _normals(seen))
        ring = replace(ring, up=rough if found is None else found)
    return replace(ring, middle=middle + 0.1 * radius * ring.up)  # the ground is dense, too


def _on_ring(scene: Gaussians, ring: Ring, count: int) -> list[Camera]:
    """`count` views all around, each the first of STEPS that is nearly the clearest of them."""
    east, chosen = perpendicular(ring.up), []
    for i in range(count):
        higher = 2 * i >= count
        turn = partial(towards, ring.up, east, tau * (2 * i + (higher and count % 2 == 0)) / count)
        judged = [ring.seen(scene, turn(radians(e)), away) for e, away in STEPS[higher:]]
        best = max(view.clear for view in judged)
        chosen.append(next(view.camera for view in judged if view.clear >= best - AS_CLEAR))
    return chosen


def upright(camera: Camera, up: Vector) -> Camera:
    """The camera turned about its view until up is up; as it is if it looks straight up or down."""
    up = torch.nn.functional.normalize(up.double(), dim=0)
    if float((camera.forward @ up).abs()) > 0.99:
        return camera
    ahead = camera.center + camera.forward
    return look_at(camera.center, ahead, up, FOV, camera.width, camera.height)


@torch.no_grad()
def score_render(scene: Gaussians, camera: Camera) -> ScoredView:
    """The score of a view from a small render: as in `score_panorama`, less
    the spread of depths in rays."""
    radius = ((scene.log_scales.sum(-1) - scene.log_scales.amin(-1)) / 2).exp()
    distance = (scene.means - camera.center.to(scene.means)).norm(dim=-1)
    with torch.enable_grad():
        dc = torch.zeros(len(scene), 1, 3, dtype=scene.means.dtype, requires_grad=True)
        drawn = render(replace(scene, sh=dc), camera, depth=True, median_depth=True)
        (slope,) = torch.autograd.grad(drawn.color[..., 0].sum(), dc)  # linear in the color
    weights = slope[:, 0, 0] / SH_DC
    total = weights.sum().clamp_min(1e-9)
    detail = (total / weights.square().sum().clamp_min(1e-9)).clamp_min(1e-4).log()
    blurred = weights[radius > BLURRED * distance].sum() / total
    mean, depth = drawn.depth, drawn.median_depth
    assert mean is not None
    assert depth is not None
    spread = (mean / depth.clamp_min(1e-9) - 1).abs().clamp_max(1)[depth > 0]
    spread = spread.mean() if len(spread) else torch.tensor(1.0)
    clear = float(OPAQUE * drawn.alpha.mean() - BLUR * blurred - SPREAD * spread)
    return ScoredView(camera, float(detail) + clear, clear, weights, depth)


def cover(found: Sequence[ScoredView], count: int) -> list[int]:
    """At most `count` views that show well all that these views show: each next one is the one
    whose well-shown Gaussians were shown least often."""
    weights = torch.stack([view.weights for view in found])
    well = (weights >= 0.2 * weights.amax(0).clamp_min(1e-9)).to(weights)
    worth = weights.sum(0)
    times, chosen = torch.zeros_like(worth), []
    for _ in range(min(count, len(found))):
        gain = well @ (worth / (1 + times) ** 2)
        gain[chosen] = -1
        chosen.append(int(gain.argmax()))
        times += well[chosen[-1]]
    return chosen


def _judged(
    scene: Gaussians, places: Places, wish: ViewConstraints, near: float, effort: SearchEffort
) -> list[ScoredView]:
    """Views from the places, turned in any way, that differ: each one taken lowers the score of its
    panorama for its like. Of these, those whose renders have nearly the best score."""
    eyes = places.points[:, None]
    forwards = directions_around(effort.directions)[None].expand(len(eyes), -1, -1)
    if wish.look_at is not None:
        forwards = torch.nn.functional.normalize(wish.look_at.float() - eyes, dim=-1)
    times = forwards.shape[1]
    seen = [score_panorama(view, cones(each)) for view, each in zip(places.views, forwards)]
    scores, forwards = torch.cat(seen), forwards.reshape(-1, 3)
    reach = torch.stack([view.reach for view in places.views]).clamp_min(1e-9)
    eyes, reach = (each.repeat_interleave(times, 0) for each in (places.points, reach))
    judged = []
    for _ in range(min(effort.rendered, len(scores))):
        best = int(scores.argmax())
        eye, forward = eyes[best].double(), forwards[best].double()
        camera = look_at(eye, eye + forward, perpendicular(forward), FOV, SMALL, SMALL)
        judged.append(score_render(scene, replace(camera, near=near)))
        apart = (eyes - eyes[best]).norm(dim=-1) / reach[best]
        turned = torch.acos((forwards @ forwards[best]).clamp(-1, 1))
        scores -= torch.exp(-((apart / 0.3) ** 2) - (turned / 0.5) ** 2)
        scores[best] = -torch.inf
    least = max(view.score for view in judged) - ADMITTED
    return [view for view in judged if view.score >= least]


def _up(scene: Gaussians, judged: Sequence[ScoredView]) -> Vector:
    """Up, from good views in any direction; where they do not say, from the densest layer."""
    forwards = torch.stack([view.camera.forward for view in judged])
    up = find_up(directions_around(1000).double(), _normals(judged), forwards)
    return guess_up(scene) if up is None else up


def _normals(judged: Iterable[ScoredView]) -> Float[Tensor, "n 3"]:
    """The normals of what the views show."""
    maps = torch.cat([normals_of_depth(view.camera, view.depth, 1) for view in judged])
    return maps[maps.any(-1)].double()
