"""A stage: named things on a setting, exact pictures and Gaussians of it, and of it after changes.

`n` Gaussians, `h w` pixels. World units; up is +z; the scene's ball is around the origin.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import radians

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from bench.staged.thing import GAMMA, Daylight, Thing, arriving, snow_on, sun_rays
from gsedit.bench.synthetic.paint import OCCLUSION_REACH, Colors, Paint, mix, parts, plain, waves
from gsedit.bench.synthetic.scene import SyntheticScene
from gsedit.bench.synthetic.shapes import Points, Sdf, Triple, gradient, union
from gsedit.bench.synthetic.splats import surface_gaussians
from gsedit.scene.similarity import Similarity
from gsedit.views.orbit import towards
from rasterizer.camera import Camera, look_at
from rasterizer.numerics import color_to_sh
from rasterizer.scene import Gaussians, concatenate

UP = torch.tensor((0.0, 0.0, 1.0), dtype=torch.float64)
EAST = torch.tensor((1.0, 0.0, 0.0), dtype=torch.float64)
BLEND = 0.004
"""World units over which the paints of two things that touch are mixed."""
SAME = 1e-6
"""World units: where the distance to the surface changed by less, the surface did not."""
SAME_COLOR = 1e-3
"""Difference of SH coefficients below which a color is as it was."""
CLEAR = 0.01
"""World units before a surface at which what touches it is told from open space."""
BESIDE = 0.03
"""World units within which a thing colors what it touches."""
SNOW = mix(plain((0.93, 0.95, 0.98)), plain((0.86, 0.9, 0.96)), waves(0.25))


@dataclass(frozen=True)
class Rig:
    """Places of cameras: (azimuth, elevation) in degrees around a point; azimuth -90 is before
    the scene, on the -y side."""

    training: Sequence[Triple]
    held_out: Sequence[Triple]
    target: Triple = (0.0, 0.0, 0.0)
    distance: float = 2.6
    fov: float = 45.0

    def cameras(self, places: Sequence[Triple], size: int) -> tuple[Camera, ...]:
        """Cameras of `size`^2 pixels at some places."""
        target = torch.tensor(self.target, dtype=torch.float64)
        away = (towards(UP, EAST, radians(a), radians(e)) for a, e in places)
        eyes = (target + self.distance * each for each in away)
        return tuple(look_at(eye, target, UP, self.fov, size, size) for eye in eyes)


@dataclass(frozen=True, eq=False)
class Labelled:
    """Gaussians of a stage, and the thing that each belongs to."""

    scene: Gaussians
    labels: Int[Tensor, " n"]
    """Index into the stage's things."""
    names: tuple[str, ...]

    def of(self, *names: str) -> Bool[Tensor, " n"]:
        """Whether each Gaussian is of one of the named things."""
        wanted = torch.tensor([self.names.index(name) for name in names])
        return torch.isin(self.labels, wanted)


@dataclass(frozen=True, eq=False)
class Stage:
    """Things on a setting under a light. Every change returns another stage; none is in place."""

    name: str
    setting: tuple[Thing, ...]
    """Parts that stay: ground, walls, a pedestal."""
    things: tuple[Thing, ...]
    """Named solids that can be taken, moved or changed."""
    light: Daylight
    rig: Rig
    background: Triple = (0.78, 0.85, 0.92)
    radius: float = 1.6
    """Radius of the ball that holds the scene; what reaches out of it is cut off."""

    @property
    def everything(self) -> tuple[Thing, ...]:
        """The setting, then the things: labels are indices into it."""
        return self.setting + self.things

    def thing(self, name: str) -> Thing:
        """The thing or part of the setting with a name; KeyError without one."""
        return {each.name: each for each in self.everything}[name]

    @cached_property
    def scene(self) -> SyntheticScene:
        """The lit scene, which can be traced."""
        solid = union(*(each.solid for each in self.everything))
        coat = parts(*((each.solid, each.coat) for each in self.everything), blend=BLEND)
        background = torch.tensor(self.background, dtype=torch.float64)
        paint = _lit(coat, solid, self.light, 2 * self.radius)
        return SyntheticScene(self.name, solid, paint, background, self.radius, UP)

    def training(self, size: int = 96) -> tuple[Camera, ...]:
        """Cameras of the capture, `size`^2 pixels."""
        return self.rig.cameras(self.rig.training, size)

    def held_out(self, size: int = 96) -> tuple[Camera, ...]:
        """Cameras to measure at, between those of the capture."""
        return self.rig.cameras(self.rig.held_out, size)

    def photo(self, camera: Camera, supersample: int = 2) -> Float[Tensor, "h w 3"]:
        """The exact picture, float32 in [0, 1]."""
        return self.scene.trace(camera, supersample).image.float()

    def labels(self, points: Points) -> Int[Tensor, "*b"]:
        """Index of the nearest of `everything` at points."""
        points = points.detach().double()
        return torch.stack([each.solid(points) for each in self.everything], -1).argmin(-1)

    def mask(self, camera: Camera, *names: str) -> Bool[Tensor, "h w"]:
        """Whether each pixel's center sees one of the named things."""
        return torch.isin(self.label_map(camera), torch.tensor([self._index(n) for n in names]))

    def label_map(self, camera: Camera) -> Int[Tensor, "h w"]:
        """Index of the thing that each pixel's center sees; -1 for the background."""
        labels = torch.full((camera.height, camera.width), -1)
        traced = replace(self.scene, albedo=plain((0, 0, 0))).trace(camera)  # light is not asked
        xy = camera.pixel_centers()[traced.hit]
        labels[traced.hit] = self.labels(camera.unproject(xy, traced.depth[traced.hit]))
        return labels

    def gaussians(self, count: int = 8000, seed: int = 0, sh_degree: int = 0) -> Labelled:
        """About `count` opaque discs on the surface, float32, and whose they are.

        The things have smaller ones than the setting, and what faces no camera has none, as in a
        capture.
        """
        whole = surface_gaussians(self.scene, count, torch.Generator().manual_seed(seed), sh_degree)
        scene = whole[self.labels(whole.means) < len(self.setting)]
        if self.things:
            scene = concatenate(scene, self._things_gaussians(count, seed + 1, sh_degree))
        return self.labelled(scene[self._faced(scene.means)])

    def _things_gaussians(self, count: int, seed: int, sh_degree: int) -> Gaussians:
        """Discs on the things, of as many as cover all that is in a ball around them."""
        low = torch.tensor([each.low for each in self.things]).amin(0).double()
        high = torch.tensor([each.high for each in self.things]).amax(0).double()
        middle, reach = 0.5 * (low + high), 0.52 * float((high - low).norm())
        near = _about(self.scene, middle, reach)
        discs = surface_gaussians(near, count, torch.Generator().manual_seed(seed), sh_degree)
        discs = replace(discs, means=discs.means + middle.float())
        return discs[self.labels(discs.means) >= len(self.setting)]

    def gaussians_from(
        self, before: Stage, given: Labelled, count: int = 8000, seed: int = 0
    ) -> tuple[Labelled, Int[Tensor, " m"]]:
        """Gaussians of this stage that are those `given` (exact ones) of the stage before it was
        changed, as far as the surface is still there, in their color of now; and the row of each
        before, -1 for new."""
        now, then = self.scene.sdf, before.scene.sdf
        kept = _both_have(then, now, given.scene.means.double())
        old = given.scene[kept]
        exact = self.colored(old).sh
        turned = (exact - before.colored(old).sh).abs().amax((1, 2)) > SAME_COLOR
        turned |= ~_both_have(then, now, old.means.double(), BESIDE)
        sh = torch.where(turned[:, None, None], exact, old.sh)
        fresh = self.gaussians(count, seed, old.degree).scene
        fresh = fresh[~_both_have(now, then, fresh.means.double())]
        origin = torch.cat((kept.nonzero().squeeze(-1), torch.full((len(fresh),), -1)))
        return self.labelled(concatenate(replace(old, sh=sh), fresh)), origin

    def colored(self, scene: Gaussians) -> Gaussians:
        """Gaussians near the surface in its color and light, the same from all sides."""
        sh = torch.zeros_like(scene.sh)
        sh[:, 0] = color_to_sh(self.scene.albedo(_onto(self.scene.sdf, scene.means.double())))
        return replace(scene, sh=sh)

    def _faced(self, means: Points) -> Bool[Tensor, " n"]:
        """Whether the surface near points is turned to a camera."""
        means = means.double()
        normals = gradient(self.scene.sdf, means)
        faced = torch.zeros(len(means), dtype=torch.bool)
        for camera in (*self.training(), *self.held_out()):
            faced |= (normals * (camera.center.double() - means)).sum(-1) > 0
        return faced

    def labelled(self, scene: Gaussians) -> Labelled:
        """Any Gaussians of this stage with the nearest thing each: fitted ones, for example."""
        return Labelled(scene, self.labels(scene.means), tuple(t.name for t in self.everything))

    def without(self, *names: str) -> Stage:
        """The stage had these things never been there: no shadow of theirs is left."""
        for name in names:
            self.thing(name)
        return replace(
            self,
            setting=tuple(t for t in self.setting if t.name not in names),
            things=tuple(t for t in self.things if t.name not in names),
        )

    def with_thing(self, thing: Thing) -> Stage:
        """The stage with one more thing, or with another one of that name."""
        if thing.name in (each.name for each in self.everything):

            def swap(row: tuple[Thing, ...]) -> tuple[Thing, ...]:
                return tuple(thing if each.name == thing.name else each for each in row)

            return replace(self, setting=swap(self.setting), things=swap(self.things))
        return replace(self, things=(*self.things, thing))

    def moved(self, name: str, similarity: Similarity) -> Stage:
        """The stage with a thing moved, turned and scaled."""
        return self.with_thing(self.thing(name).moved(similarity))

    def relit(self, light: Daylight) -> Stage:
        """The stage under another light, with the shadows of that."""
        return replace(self, light=light)

    def snowed(self, thickness: float, *names: str) -> Stage:
        """The stage with a thing "snow": a layer on what faces up and sees the sky of the named
        things, or of all; `thickness` in world units on level places, less on slopes."""
        names = names or tuple(each.name for each in self.everything)
        covered = union(*(self.thing(name).solid for name in names))
        whole = union(*(each.solid for each in self.everything))
        boxes = [self.thing(name) for name in names]
        top = max(each.high[2] for each in self.everything)
        low = tuple(min(each.low[i] for each in boxes) for i in range(3))
        high = tuple(max(each.high[i] for each in boxes) + (i == 2) * thickness for i in range(3))
        snow = Thing("snow", snow_on(covered, whole, thickness, top), SNOW, low, high)
        return self.with_thing(snow)

    def _index(self, name: str) -> int:
        return [each.name for each in self.everything].index(name)


def _about(scene: SyntheticScene, middle: Float[Tensor, "3"], reach: float) -> SyntheticScene:
    """A ball of a scene, with its middle at the origin."""
    return replace(
        scene,
        sdf=lambda points: scene.sdf(points + middle.to(points)),
        albedo=lambda points: scene.albedo(points + middle.to(points)),
        radius=reach,
    )


def _onto(solid: Sdf, points: Points) -> Points:
    """Points near a surface, moved onto it."""
    return points - solid(points)[..., None] * gradient(solid, points)


def _both_have(solid: Sdf, other: Sdf, points: Points, clear: float = CLEAR) -> Bool[Tensor, " n"]:
    """Whether the other solid has the same surface near points of the solid's surface."""
    normals = torch.nn.functional.normalize(gradient(solid, points), dim=-1)
    before_it = _onto(solid, points) + clear * normals
    return (other(before_it) - solid(before_it)).abs() < SAME


def _lit(coat: Paint, solid: Sdf, light: Daylight, reach: float) -> Paint:
    """The paint under the sun with its exact shadow, and a sky that creases see less of.

    The sky's share is smooth by construction (`lit` has the same): exact rays to a few parts of the
    sky would draw a step into the picture for each.
    """
    sun = sun_rays(light)

    def paint(points: Points) -> Colors:
        points = points.double()
        normals = torch.nn.functional.normalize(gradient(solid, points), dim=-1)
        openness = torch.ones_like(points[..., 0])
        for distance in OCCLUSION_REACH:
            clearance = solid(points + distance * normals) / distance
            openness = openness * (0.6 + 0.4 * clearance.clamp(0, 1))
        up = 0.5 + 0.5 * normals[..., 2:]
        around = points.new_tensor(light.sky) * up + points.new_tensor(light.ground) * (1 - up)
        sunny = arriving(solid, points, normals, sun, reach)[..., None] / len(sun)
        shade = around * openness[..., None] + sunny * points.new_tensor(light.sunlight)
        return (coat(points) * shade ** (1 / GAMMA)).clamp(0, 1)

    return paint
