"""Views of a scene that came without cameras, from where it looks as if it was captured: judged by
small renders, level, few; and renders from them.

`c` candidates, `n` Gaussians.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import radians, tau

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.errors import UsageError
from gsedit.scene.framing import bounds, guess_up
from gsedit.scene.merging import coarsen
from gsedit.views.dataset import Dataset
from gsedit.views.normals import normals_of_depth
from gsedit.views.orbit import ELEVATION, orbit, perpendicular, towards, unit_up
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
    up: Float[Tensor, "3"] | None = None,
    *,
    look_at: Float[Tensor, "3"] | None = None,
    eye: Float[Tensor, "3"] | None = None,
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
    if cameras:
        return cameras
    found = find_viewpoints(scene, count, size)
    return [each.camera for each in found]


NARROW = 0.96
"""Cosine (16 degrees) within which a surface's normal counts for a direction."""


def find_up(
    directions: Float[Tensor, "d 3"],
    normals: Float[Tensor, "n 3"],
    forwards: Float[Tensor, "v 3"] | None = None,
) -> Float[Tensor, "3"] | None:
    """The upward unit vector, float64; None where nothing says.

    Of `directions`, the one that most of the surfaces in view face, while the views, if any are
    given, look across it: a person holds a camera level, so that a wall, which one view faces, is
    one that others look along. Twice the mean square of forward . up is 1 for a wall's normal in a
    room.
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
SIDES = 100
"""Directions from which the middle of a scene is looked at."""
ONE_SIDED, CLOSED = 0.6, 0.9
"""How much better the views from above the ground are at least (1.1 to 3.2 in these fits; 0.3 and
0.2 around a room and an object alone), and their least opacity."""
STEPS = ((15.0, 1.0), (30.0, 1.0), (45.0, 1.0), (25.0, 0.75))
"""Elevations, degrees, and distances, in radii of the ring, in the order in which they are liked:
every other view begins with the second."""
AS_CLEAR = 0.5
"""How much less clear than the best of its steps a view may be."""
HAZE = 0.25
"""Near plane of views on a ring, in its radii: floaters hang about where cameras were."""


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


@dataclass(frozen=True, eq=False)
class Candidates:
    """Views by place and direction, with the score of the panorama there."""

    eyes: Float[Tensor, "c 3"]
    forwards: Float[Tensor, "c 3"]
    scores: Float[Tensor, " c"]
    reach: Float[Tensor, " c"]
    """Distance of what each place sees: the scale on which places differ."""


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
    ring = find_ring(scene, sample, wish.up) if free else None
    if ring is not None:
        return tuple(camera.resized(size, size) for camera in _on_ring(scene, ring, count))
    places = find_places(sample, wish, generator, effort)
    if free and places.enclosed < SURROUNDED:
        return _orbits(scene, count, size, wish.up, rings)
    judged = _judged(scene, places, count, wish, generator, ball.near, effort)
    up = _up(scene, judged) if wish.up is None else wish.up
    chosen = [upright(judged[i].camera, up) for i in cover(judged, count)]
    if wish.eye is not None and wish.look_at is not None:  # the first view is the very one
        exact = look_at(wish.eye, wish.look_at, perpendicular(wish.look_at - wish.eye), FOV, 1, 1)
        chosen = [upright(exact, up), *chosen[1:]]
    return tuple(replace(camera.resized(size, size), near=ball.near) for camera in chosen)


def _orbits(
    scene: Gaussians, count: int, size: int, up: Float[Tensor, "3"] | None, rings: Sequence[float]
) -> tuple[Camera, ...]:
    """An orbit at each elevation, `count` cameras in all."""
    each = max(1, count // len(rings))
    around = (orbit(scene, each, size, up=up, elevation=e, alone=True) for e in rings)
    return tuple(camera for ring in around for camera in ring)


@dataclass(frozen=True, eq=False)
class Ring:
    """Where a subject and what is around it look as if they were captured from."""

    middle: Float[Tensor, "3"]
    up: Float[Tensor, "3"]
    radius: float

    def seen(
        self, scene: Gaussians, direction: Float[Tensor, "3"], distance: float = 1.0
    ) -> ScoredView:
        """The view of the middle from a unit direction, at a distance in radii."""
        eye = self.middle + distance * self.radius * direction
        camera = look_at(eye, self.middle, self.up, FOV, SMALL, SMALL)
        return score_render(scene, replace(camera, near=HAZE * self.radius))


def find_ring(
    scene: Gaussians, sample: Sample, up: Float[Tensor, "3"] | None = None
) -> Ring | None:
    """The ring around the densest part of a scene; None where nothing is around that, as around an
    object alone, or where it looks no better from one side, as a room from outside.

    Above the ground things look sharp and closed, and from below they do not: the mean of all
    directions, weighted by the scores of the panoramas there, is about up. Up itself is then the
    direction that most surfaces face in good views from above.
    """
    means = scene.means.double()
    middle = means[scene.opacities >= scene.opacities.median()].median(0).values
    radius = CORE * float((means - middle).norm(dim=-1).sort().values[len(means) // 4])
    directions = directions_around(SIDES).double()
    scores = torch.cat([
        score_panorama(panorama(sample, middle + radius * each), mask[None])
        for each, mask in zip(directions, cones(-directions))
    ]).double()  # fmt: skip
    rough = unit_up((scores - scores.mean()) @ directions) if up is None else up
    height = directions @ rough
    if float(scores[height > 0.2].mean() - scores[height < -0.2].mean()) < ONE_SIDED:
        return None
    ring = Ring(middle, rough, radius)
    above = (height.abs() < 0.9).nonzero()[:, 0]
    above = above[height[above] > -0.1]
    best = above[scores[above].argsort(descending=True)[:FOUND_VIEWS]]
    seen = [ring.seen(scene, each) for each in directions[best]]
    if float(torch.stack([view.weights.sum() for view in seen]).median()) < CLOSED * SMALL**2:
        return None
    if up is None:
        near = directions_around(1000).double()
        found = find_up(near[near @ rough > 0.5], _normals(seen))
        ring = replace(ring, up=rough if found is None else found)
    return replace(ring, middle=middle + 0.1 * radius * ring.up)  # the ground is dense, too


def _on_ring(scene: Gaussians, ring: Ring, count: int) -> list[Camera]:
    """`count` views evenly around; each is the first of STEPS that is nearly the best of them."""
    east, chosen = perpendicular(ring.up), []
    for i in range(count):
        steps = STEPS if i % 2 == 0 else (STEPS[1], STEPS[0], *STEPS[2:])
        judged = [
            ring.seen(scene, towards(ring.up, east, tau * i / count, radians(elevation)), distance)
            for elevation, distance in steps
        ]
        best = max(view.clear for view in judged)
        chosen.append(next(view.camera for view in judged if view.clear >= best - AS_CLEAR))
    return chosen


def candidates(places: Places, target: Float[Tensor, "3"] | None, count: int) -> Candidates:
    """Every place with `count` directions all around it, or with that of the target."""
    reach = torch.stack([view.reach for view in places.views])
    if target is not None:
        forwards = torch.nn.functional.normalize(target.float() - places.points, dim=-1)
        masks = cones(forwards)
        scores = [score_panorama(view, mask[None])[0] for view, mask in zip(places.views, masks)]
        return Candidates(places.points, forwards, torch.stack(scores), reach)
    directions = directions_around(count)
    masks = cones(directions)
    scores = torch.stack([score_panorama(view, masks) for view in places.views])
    eyes = places.points.repeat_interleave(count, 0)
    forwards = directions.repeat(len(places.points), 1)
    return Candidates(eyes, forwards, scores.reshape(-1), reach.repeat_interleave(count))


def upright(camera: Camera, up: Float[Tensor, "3"]) -> Camera:
    """The camera turned about its view until up is up; as it is if it looks straight up or down."""
    up = torch.nn.functional.normalize(up.double(), dim=0)
    if float((camera.forward @ up).abs()) > 0.99:
        return camera
    eye = camera.center
    return look_at(eye, eye + camera.forward, up, FOV, camera.width, camera.height)


def pick(views: Candidates, count: int) -> list[int]:
    """The best views that differ: each one taken lowers the score of its like."""
    scores, chosen = views.scores.clone(), []
    for _ in range(min(count, len(scores))):
        best = int(scores.argmax())
        chosen.append(best)
        apart = (views.eyes - views.eyes[best]).norm(dim=-1) / views.reach[best].clamp_min(1e-9)
        turned = torch.acos((views.forwards @ views.forwards[best]).clamp(-1, 1))
        scores -= torch.exp(-((apart / 0.3) ** 2) - (turned / 0.5) ** 2)
        scores[best] = -torch.inf
    return chosen


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
    assert drawn.depth is not None
    assert drawn.median_depth is not None
    depth = drawn.median_depth
    spread = (drawn.depth / depth.clamp_min(1e-9) - 1).abs().clamp_max(1)[depth > 0]
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


def vary(
    judged: Sequence[ScoredView], count: int, wish: ViewConstraints, generator: torch.Generator
) -> list[Camera]:
    """`count` cameras beside the given ones: moved by an eighth of what they see, turned a little.

    What is wished stays: the point that they look at; near the eye they hardly move.
    """
    cameras = []
    for i in range(count):
        view = judged[i % len(judged)]
        camera, seen = view.camera, view.depth[view.depth > 0].double()
        step = (0.02 if wish.eye is not None else 0.12) * float(seen.median() if len(seen) else 0)
        noise = torch.randn(2, 3, generator=generator, dtype=torch.float64)
        eye = camera.center + step * noise[0]
        ahead = camera.forward + 0.12 * noise[1]
        target = eye + ahead if wish.look_at is None else wish.look_at
        cameras.append(look_at(eye, target, -camera.rotation[1], FOV, SMALL, SMALL))
    return cameras


def _judged(
    scene: Gaussians,
    places: Places,
    count: int,
    wish: ViewConstraints,
    generator: torch.Generator,
    near: float,
    effort: SearchEffort,
) -> list[ScoredView]:
    """The admitted ones of the best candidates that differ, and of variations of them: of nearly
    the best score, the best first, turned in any way about the view."""
    views = candidates(places, wish.look_at, effort.directions)
    judged = []
    for i in pick(views, effort.rendered):
        eye, forward = views.eyes[i].double(), views.forwards[i].double()
        camera = look_at(eye, eye + forward, perpendicular(forward), FOV, SMALL, SMALL)
        judged.append(score_render(scene, replace(camera, near=near)))
    least, most = effort.rounds
    for i in range(most):
        admitted = _admitted(judged)
        if i >= least and len(admitted) >= count:
            break
        judged += [
            score_render(scene, replace(camera, near=near))
            for camera in vary(admitted, effort.varied, wish, generator)
        ]
    return _admitted(judged)


def _admitted(judged: Sequence[ScoredView]) -> list[ScoredView]:
    """Those of nearly the best score, the best first."""
    ordered = sorted(judged, key=lambda view: -view.score)
    return [view for view in ordered if view.score >= ordered[0].score - ADMITTED]


def _up(scene: Gaussians, judged: Sequence[ScoredView]) -> Float[Tensor, "3"]:
    """Up, from good views in any direction; where they do not say, from the densest layer."""
    forwards = torch.stack([view.camera.forward for view in judged])
    up = find_up(directions_around(1000).double(), _normals(judged), forwards)
    return guess_up(scene) if up is None else up


def _normals(judged: Sequence[ScoredView]) -> Float[Tensor, "n 3"]:
    """The normals of what the views show."""
    maps = torch.cat([normals_of_depth(view.camera, view.depth, 1) for view in judged])
    return maps[maps.any(-1)].double()
