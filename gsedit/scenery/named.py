"""Weather and seasons by name: the light they come in, then what they do to surfaces."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.errors import UsageError
from gsedit.light.color_change import ColorChange, only_inside
from gsedit.light.named import LIGHTS
from gsedit.light.present import survey
from gsedit.light.relight import relit_by
from gsedit.light.setup import Fog, LightSetup, Sun
from gsedit.scenery.effects import autumn, caustics, desert, frost, snow, spring, summer, wet
from gsedit.scenery.setting import Setting
from gsedit.scenery.sheens import glossy, penciled, sketch, watercolor
from rasterizer.camera import Camera
from rasterizer.numerics import AUTO, Execution
from rasterizer.scene import Gaussians

Effect = Callable[[Setting], ColorChange]
Sheen = Callable[[Setting, Gaussians, Execution], Gaussians]


@dataclass(frozen=True)
class Scenery:
    """A weather or season."""

    light: LightSetup | None
    """Light that it comes in; None: the present light."""
    effects: tuple[Effect, ...]
    """Changes of surfaces, in order, of the scene in its present light."""
    sheen: Sheen | None = None
    """Adds colors that depend on the view, to the scene after the effects."""


OVERCAST = LightSetup((0.95, 0.99, 1.05), (0.35, 0.35, 0.36))
RAIN = LightSetup(
    (0.55, 0.6, 0.66), (0.15, 0.155, 0.16), saturation=0.72,
    fog=Fog((0.5, 0.54, 0.57), 0.28, 0.3, 0.03), backdrop=(0.55, 0.59, 0.63),
)  # fmt: skip
HEAT = LightSetup((0.3, 0.27, 0.23), (0.22, 0.17, 0.11), Sun(-40.0, 58.0, 1.1, (1.0, 0.9, 0.7)))

SCENERIES: dict[str, Scenery] = {
    "snow": Scenery(OVERCAST, (snow,)),
    "frost": Scenery(OVERCAST, (frost,)),
    "rain": Scenery(RAIN, (wet,), sheen=glossy),
    "wet": Scenery(None, (wet,), sheen=glossy),
    "desert": Scenery(HEAT, (desert,)),
    "autumn": Scenery(None, (autumn,)),
    "spring": Scenery(None, (spring,)),
    "summer": Scenery(LIGHTS["sunny"], (summer,)),
    "sketch": Scenery(None, (sketch,), penciled),
    "watercolor": Scenery(None, (watercolor,)),
    "underwater": Scenery(LIGHTS["underwater light"], (caustics,)),
}
"""Weather and seasons by the names that `gsedit.words` gives them."""


def in_scenery(
    scene: Gaussians,
    name: str,
    cameras: Sequence[Camera],
    seen: Float[Tensor, " n"] | None = None,
    inside: Bool[Tensor, " n"] | None = None,
    execution: Execution = AUTO,
) -> Gaussians:
    """The scene in a weather or season; Gaussians that are not `inside` keep their coefficients.

    Arguments as of gsedit.light.relight.relit. Raises UsageError for an unknown name.
    """
    if name not in SCENERIES:
        raise UsageError(f"there is no scenery {name!r}: choose one of {', '.join(SCENERIES)}")
    scenery = SCENERIES[name]
    found = survey(scene, cameras, seen, execution)
    after = scene
    for effect in scenery.effects:
        after = effect(Setting(after, found, cameras, execution)).applied(after)
    if scenery.light is not None:
        after = relit_by(found, after, scenery.light, execution)
    if scenery.sheen is not None:
        after = scenery.sheen(Setting(scene, found), after, execution)
    return only_inside(scene, after, inside)
