"""Methods that take part in a case: gsedit's own operation, and simple baselines."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from bench.objects.files import Given, place_of
from gsedit.cameras.place import place_of as seen_place
from gsedit.light.named import LightSetup, Sun
from gsedit.light.relight import relit
from gsedit.materials.apply import in_material
from gsedit.materials.named import paint_of
from gsedit.objects.bending.bend import Handle, bend
from gsedit.objects.growth.grow import grow
from gsedit.objects.growth.table import GROWTHS, LEAST, MOST
from gsedit.objects.placing.insert import insert
from gsedit.objects.placing.place import place
from gsedit.objects.placing.placement import Placement
from gsedit.objects.removal.remove import remove
from gsedit.scene.quaternions import rotations
from gsedit.scene.table import gaussians_of, table_of
from gsedit.select.region import Region, coverage
from gsedit.synthetic.daylight import GAMMA
from rasterizer.numerics import SH_DC, color_to_sh
from rasterizer.render import render
from rasterizer.scene import Gaussians, concatenate

OURS = "gsedit"
UP = torch.tensor((0.0, 0.0, 1.0))
"""Upward direction of the scenes."""
TOUCHED = 0.05
"""Share of a pixel that the thing gives, above which the pixel is filled by a baseline."""
SNOW_COLOR = (0.9, 0.92, 0.95)
LEVEL = 0.5
"""Cosine of the slope above which a disc is covered by the baseline of growth."""


@dataclass(frozen=True, eq=False)
class Made:
    """The result of a method: a scene, or only pictures of the held-out views."""

    scene: Gaussians | None = None
    pictures: Float[Tensor, "v h w 3"] | None = None
    own: Bool[Tensor, " m"] | None = None
    """Flags of the thing's Gaussians in the result, where they are known."""

    def drawn(self, given: Given) -> Float[Tensor, "v h w 3"]:
        """The pictures of the held-out views."""
        if self.pictures is not None:
            return self.pictures
        assert self.scene is not None
        return drawn(self.scene, given)


Method = Callable[[Given], Made]


def drawn(scene: Gaussians, given: Given) -> Float[Tensor, "v h w 3"]:
    """Pictures of a scene at the held-out views of a case."""
    with torch.no_grad():
        views = [render(scene, camera).color.clamp(0, 1) for camera in given.held_out]
    return torch.stack(views)


def _removed(given: Given) -> Made:

    return Made(remove(given.scene, given.inside, given.cameras).scene)


def _dropped(given: Given) -> Made:
    return Made(given.scene[~given.inside])


def _blurred(given: Given) -> Made:
    """Drop, and fill each picture by the blurred picture around the thing."""
    from scipy.ndimage import gaussian_filter

    def fill(image: np.ndarray, hole: np.ndarray) -> np.ndarray:
        known = (~hole).astype(np.float64)
        width = max(np.sqrt(hole.sum()) / 4, 1.0)
        weight = gaussian_filter(known, width)
        blurred = [gaussian_filter(image[..., i] * known, width) for i in range(3)]
        return np.stack(blurred, -1) / np.maximum(weight, 1e-6)[..., None]

    return _filled(given, fill)


def _nearest(given: Given) -> Made:
    """Drop, and fill each picture by the nearest pixel outside of the thing."""
    from scipy.ndimage import distance_transform_edt

    def fill(image: np.ndarray, hole: np.ndarray) -> np.ndarray:
        nearest = distance_transform_edt(hole, return_distances=False, return_indices=True)
        rows, columns = np.asarray(nearest)
        return image[rows, columns]

    return _filled(given, fill)


def _filled(given: Given, fill: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> Made:
    pictures = drawn(given.scene[~given.inside], given)
    for picture, camera in zip(pictures, given.held_out):
        hole = coverage(Region(given.inside), given.scene, camera) > TOUCHED
        if hole.any():
            made = torch.from_numpy(fill(picture.double().numpy(), hole.numpy()))
            picture[hole] = made[hole].float().clamp(0, 1)
    return Made(pictures=pictures)


def _inserted(given: Given) -> Made:

    assert given.other is not None
    asked = given.change
    outcome = insert(
        given.scene, given.other, asked["at"], given.cameras, height=asked["height"], up=UP
    )
    return Made(outcome.scene, own=outcome.origin < 0)


def _joined(given: Given) -> Made:
    """Put the other scene at its exact place as it is."""
    assert given.other is not None
    scene = concatenate(given.scene, _moved(given.other, given))
    return Made(scene, own=torch.arange(len(scene)) >= len(given.scene))


def _placed(given: Given) -> Made:

    x, y, z = given.change["to"]
    asked = Placement(given.change["scale"], given.change["turn_degrees"], to=(x, y, z))
    outcome = place(given.scene, given.inside, asked, given.cameras)
    old = outcome.origin >= 0
    own = torch.zeros(len(outcome.scene), dtype=torch.bool)
    own[old] = given.inside[outcome.origin[old]]
    return Made(outcome.scene, own=own)


def _carried(given: Given) -> Made:
    """Move the thing's Gaussians to their exact place as they are; the hole stays."""
    moved = _moved(given.scene[given.inside], given)
    scene = concatenate(given.scene[~given.inside], moved)
    return Made(scene, own=torch.arange(len(scene)) >= len(scene) - len(moved))


def _moved(part: Gaussians, given: Given) -> Gaussians:
    return gaussians_of(place_of(given.case).table(table_of(part)))


def _painted(given: Given) -> Made:
    red, green, blue = (round(255 * each) for each in given.change["color"])
    paint = paint_of("paint", f"#{red:02x}{green:02x}{blue:02x}")
    return Made(in_material(given.scene, given.inside, paint, given.cameras).scene)


def _flat(given: Given) -> Made:
    """Give all of the thing's Gaussians the color that was asked for."""
    return Made(_colored(given.scene, given.inside, torch.tensor(given.change["color"])))


def _relit(given: Given) -> Made:
    asked = given.change
    place = seen_place(given.scene, given.cameras)
    toward = torch.nn.functional.normalize(torch.tensor(asked["sun"]).double(), dim=0)
    elevation = float(torch.rad2deg(torch.asin(toward @ place.up)))
    azimuths = torch.arange(-180.0, 180.0)
    level = torch.stack([place.direction(float(a), elevation) for a in azimuths])
    azimuth = float(azimuths[(level @ toward).argmax()])
    strength = max(asked["sunlight"])
    red, green, blue = (each / strength for each in asked["sunlight"])
    sun = Sun(azimuth, elevation, strength, (red, green, blue))
    setup = LightSetup(tuple(asked["sky"]), tuple(asked["ground"]), sun)
    return Made(relit(given.scene, setup, given.cameras))


def _gained(given: Given) -> Made:
    """Multiply all colors by the light on a level place, asked for over now."""

    def level(light: dict[str, list[float]]) -> Tensor:
        sun = torch.tensor(light["sun"])
        return torch.tensor(light["sunlight"]) * sun[2] / sun.norm() + torch.tensor(light["sky"])

    gain = (level(given.change) / level(given.change["now"])) ** (1 / GAMMA)
    color = (given.scene.sh[:, 0] * SH_DC + 0.5) * gain
    everything = torch.ones(len(given.scene), dtype=torch.bool)
    return Made(_colored(given.scene, everything, color))


def _bent(given: Given) -> Made:
    handles = [Handle(tuple(point), tuple(goal)) for point, goal in given.change["handles"]]
    return Made(bend(given.scene, given.inside, handles).scene)


def _unchanged(given: Given) -> Made:
    """Leave the scene as it is."""
    return Made(given.scene)


def _grown(given: Given) -> Made:

    part = given.scene.means[given.inside]
    size = float((part.amax(0) - part.amin(0)).norm())
    amount = given.change["thickness"] / (GROWTHS["snow"].thickness * size)
    amount = min(max(amount, LEAST), MOST)
    return Made(grow(given.scene, "snow", amount, given.inside, given.cameras).scene)


def _whitened(given: Given) -> Made:
    """Color what faces up and is in the upper half of the thing white."""
    scene = given.scene
    turns = rotations(scene.quats.double().numpy())
    thin = scene.log_scales.argmin(-1).numpy()
    up = torch.from_numpy(np.abs(turns[np.arange(len(thin)), 2, thin]))
    high = scene.means[:, 2] > scene.means[given.inside, 2].median()
    covered = given.inside & high & (up > LEVEL)
    return Made(_colored(scene, covered, torch.tensor(SNOW_COLOR)))


def _colored(scene: Gaussians, rows: Bool[Tensor, " n"], color: Tensor) -> Gaussians:
    sh = scene.sh.clone()
    values = color_to_sh(color.to(sh).expand(len(scene), 3)[rows])
    sh[rows] = 0
    sh[rows, 0] = values
    return Gaussians(scene.means, scene.quats, scene.log_scales, scene.logit_opacities, sh)


METHODS: dict[str, dict[str, Method]] = {
    "removal": {
        OURS: _removed, "drop only": _dropped, "drop and blur": _blurred,
        "drop and nearest": _nearest,
    },
    "insertion": {OURS: _inserted, "as it is": _joined},
    "move": {OURS: _placed, "as it is": _carried},
    "recolor": {OURS: _painted, "one color": _flat},
    "relight": {OURS: _relit, "one gain": _gained},
    "deform": {OURS: _bent, "unchanged": _unchanged},
    "growth": {OURS: _grown, "white on top": _whitened},
}  # fmt: skip
"""Methods of each task, by name."""
