"""A scene in the browser (viser): a page on this machine, or one HTML file that needs no network.

viser draws with WebGL: splats with their covariances, sorted by depth. Its file has no controls, so
a few lines of switch.js are put in, which reach viser's list of scene nodes through React.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass
from html import escape
from io import StringIO
from math import atan
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Bool, Float32
from torch import Tensor

from gsedit.errors import UsageError
from gsedit.pictures.viewer.drawing import CAMERA_COLOR, frustum_length
from gsedit.pictures.viewer.libraries import guarded, import_viser
from gsedit.pictures.viewer.point_clouds import splat_colors
from gsedit.run.atomic import atomic_path
from gsedit.scene.framing import bounds
from gsedit.select.region import TINT, TINT_STRENGTH
from gsedit.views.viewpoints import Viewpoint
from rasterizer.camera import Camera
from rasterizer.project import rotation_matrices
from rasterizer.scene import Gaussians

BEFORE, AFTER = "before", "after"


@dataclass(frozen=True, eq=False)
class Splats:
    """Gaussians as a browser takes them."""

    means: Float32[np.ndarray, "n 3"]
    covariances: Float32[np.ndarray, "n 3 3"]
    colors: Float32[np.ndarray, "n 3"]
    """RGB in [0, 1]."""
    opacities: Float32[np.ndarray, " n"]

    def __len__(self) -> int:
        return len(self.means)


@dataclass(frozen=True, eq=False)
class Layer:
    """Splats that are shown together."""

    name: str
    splats: Splats
    scenes: tuple[str, ...]
    """While which of the scenes is shown: BEFORE, AFTER or both."""
    tinted: bool | None = None
    """Shown only with the region tinted (True), only without (False), or always (None)."""


def splats_of(scene: Gaussians) -> Splats:
    """Centers, covariances, base colors and opacities, float32."""
    scene = scene.detach()
    factor = rotation_matrices(scene.quats) * scene.scales[:, None]
    covariances = factor @ factor.mT
    arrays = (scene.means, covariances, splat_colors(scene), scene.opacities)
    return Splats(*(array.float().cpu().numpy() for array in arrays))


def make_layers(
    before: Gaussians, after: Gaussians | None = None, region: Bool[Tensor, " m"] | None = None
) -> list[Layer]:
    """The layers of one or two scenes, none of them empty.

    Gaussians that an edit left as they were, in the same row of both scenes, are in the page once.
    A `region` holds for the scene of as many Gaussians; its Gaussians are there twice, plain and
    tinted. Raises UsageError for a region of another number of Gaussians.
    """
    scenes = {BEFORE: before} if after is None else {BEFORE: before, AFTER: after}
    if region is not None and len(region) not in {len(scene) for scene in scenes.values()}:
        counts = " and ".join(f"{len(scene)}" for scene in scenes.values())
        raise UsageError(
            f"the region has {len(region)} flags and the scene {counts} Gaussians: it belongs to "
            "another scene"
        )
    same = torch.zeros(len(before), dtype=torch.bool)
    if after is not None and len(after) == len(before):
        same = unchanged(before, after)
    layers = _split("both", before, same, (BEFORE, AFTER), region)
    for name, scene in scenes.items():
        own = ~same if len(scene) == len(before) else torch.ones(len(scene), dtype=torch.bool)
        layers += _split(name, scene, own, (name,), region)
    return [layer for layer in layers if len(layer.splats)]


def unchanged(before: Gaussians, after: Gaussians) -> Bool[Tensor, " n"]:
    """The rows that look the same in a browser: all but the coefficients of higher harmonics."""
    rows = (before.sh[:, 0] == after.sh[:, 0]).all(1)
    rows &= before.logit_opacities == after.logit_opacities
    for name in ("means", "quats", "log_scales"):
        rows &= (getattr(before, name) == getattr(after, name)).all(1)
    return rows


def _split(
    name: str,
    scene: Gaussians,
    rows: Bool[Tensor, " n"],
    shown: tuple[str, ...],
    region: Bool[Tensor, " m"] | None,
) -> list[Layer]:
    """The rows of a scene outside the region, inside it, and inside it tinted."""
    if region is None or len(region) != len(scene):
        return [Layer(name, splats_of(scene[rows]), shown)]
    inside = splats_of(scene[rows & region])
    tint = np.array(TINT, dtype=np.float32)
    colors = (1 - TINT_STRENGTH) * inside.colors + TINT_STRENGTH * tint
    tinted = Splats(inside.means, inside.covariances, colors.astype(np.float32), inside.opacities)
    return [
        Layer(f"{name}_outside", splats_of(scene[rows & ~region]), shown),
        Layer(f"{name}_inside", inside, shown, tinted=False),
        Layer(f"{name}_tinted", tinted, shown, tinted=True),
    ]


def shown_layers(layers: Sequence[Layer], scene: str, tinted: bool) -> list[str]:
    """The names of the layers that are visible in one state of the page."""
    return [
        layer.name for layer in layers if scene in layer.scenes and layer.tinted in (None, tinted)
    ]


LOCALHOST = "127.0.0.1"
RADIUS = 20.0
"""Radius of the scene's bulk in the page. viser sends covariances as float16: at this size they
hold standard deviations from 1e-5 to 12 of the scene's radius."""
FLOAT16_MOST = 65_000.0
FARTHEST = 50.0
"""Radii. viser sorts by depth in 65,536 steps from the nearest splat to the farthest: a few splats
far outside would leave the scene a few steps."""
CAMERAS = "cameras"
_WORKERS = """
if (location.protocol === "file:") {
  const make = URL.createObjectURL.bind(URL);
  URL.createObjectURL = (blob) => {
    if (/javascript/.test(blob.type || "")) throw new Error("no worker from a blob on disk");
    return make(blob);
  };
}
"""
"""Chromium starts no module worker from a blob of a page on disk, and the worker sorts the splats:
viser's own second way, a data URL, works, and is taken where the first one fails at once."""
_SWITCH = Path(__file__).with_name("switch.js")


@dataclass(frozen=True, eq=False)
class Page:
    """All that a page shows."""

    layers: tuple[Layer, ...]
    camera: Camera
    """Camera of the first view."""
    title: str
    cameras: tuple[Viewpoint, ...] = ()
    frustum_length: float = 1.0
    """Length of the drawn frustums, world units."""
    center: tuple[float, float, float] = (0.0, 0.0, 0.0)
    radius: float = 1.0
    """Radius of the scene's bulk, world units."""

    @property
    def scale(self) -> float:
        """Units of the page in a world unit."""
        return RADIUS / self.radius

    def point(self, position: Tensor) -> np.ndarray:
        """A point of the world in the page: its origin is the middle of the scene's bulk."""
        return (position.detach().double().numpy() - np.array(self.center)) * self.scale

    def placed(self, splats: Splats) -> Splats:
        """The splats in the page. What is FARTHEST away or farther is drawn nearer and smaller by
        the same factor: it looks the same from the middle."""
        means = (splats.means - np.array(self.center, dtype=np.float32)) * np.float32(self.scale)
        distance = np.linalg.norm(means, axis=1) / (FARTHEST * RADIUS)
        nearer = 1 / np.maximum(distance, 1)
        factor = (nearer * self.scale) ** 2
        covariances = (splats.covariances * factor[:, None, None]).clip(-FLOAT16_MOST, FLOAT16_MOST)
        return Splats(
            (means * nearer[:, None]).astype(np.float32),
            covariances.astype(np.float32),
            splats.colors,
            splats.opacities,
        )

    @property
    def has_after(self) -> bool:
        return any(AFTER in layer.scenes and BEFORE not in layer.scenes for layer in self.layers)

    @property
    def has_region(self) -> bool:
        return any(layer.tinted for layer in self.layers)


def make_page(
    scene: Gaussians,
    camera: Camera,
    *,
    after: Gaussians | None = None,
    region: Bool[Tensor, " m"] | None = None,
    cameras: Sequence[Viewpoint] = (),
    title: str = "gsedit",
) -> Page:
    """A page of one or two scenes. Raises UsageError as `make_layers` does."""
    bulk = bounds(scene)
    length = frustum_length(cameras, scene) if cameras else 1.0
    layers = tuple(make_layers(scene, after, region))
    return Page(layers, camera, title, tuple(cameras), length, bulk.center, bulk.radius)


def write_page(page: Page, path: Path | str, *, overwrite: bool = False) -> None:
    """Write one HTML file that shows the page from disk, without a network.

    Raises GseditError where viser is missing, UsageError as `atomic_path` does.
    """
    text = as_html(page)
    with atomic_path(path, overwrite=overwrite) as temporary:
        temporary.write_text(text, encoding="utf-8")


def as_html(page: Page) -> str:
    """The text of the file of `write_page`."""
    with server(page, port=0) as (live, _):
        html = live.get_scene_serializer().as_html()
    states = {
        f"{scene} {str(tinted).lower()}": shown_layers(page.layers, scene, tinted)
        for scene in (BEFORE, AFTER)
        for tinted in (False, True)
    }
    data = {
        "layers": [layer.name for layer in page.layers],
        "states": states,
        "after": page.has_after,
        "region": page.has_region,
        "cameras": len(page.cameras),
    }
    script = _SWITCH.read_text(encoding="utf-8").replace("PAGE", json.dumps(data), 1)
    html = html.replace("<title>Viser</title>", f"<title>{escape(page.title)}</title>", 1)
    html = html.replace("<head>", f"<head>\n<script>{_WORKERS}</script>", 1)
    end = html.rindex("</body>")
    return f"{html[:end]}<script>{script}</script>{html[end:]}"


@contextmanager
def server(page: Page, port: int) -> Iterator[Any]:
    """A viser server of the page that only this machine can reach, and no other web site; at
    another port where that one is taken. Raises GseditError where viser is missing."""
    viser = import_viser()
    with redirect_stdout(StringIO()), guarded():  # it says where it listens, in a box
        live = viser.ViserServer(host=LOCALHOST, port=port, label=page.title, verbose=False)
    try:
        live.gui.configure_theme(show_share_button=False)  # it would open a tunnel to viser's host
        yield live, _fill(live, page)
    finally:
        with redirect_stdout(StringIO()):  # "Server stopped"
            live.stop()


def add_controls(live: Any, page: Page, handles: dict[str, Any]) -> None:
    """Before / after, region and cameras as controls of a live page, for all who look at it."""
    gui = live.gui
    which = gui.add_checkbox("after", initial_value=True) if page.has_after else None
    tint = gui.add_checkbox("region", initial_value=False) if page.has_region else None
    cameras = gui.add_checkbox("cameras", initial_value=False) if page.cameras else None

    def update(_: Any = None) -> None:
        scene = AFTER if which and which.value else BEFORE
        shown = shown_layers(page.layers, scene, bool(tint and tint.value))
        for layer in page.layers:
            handles[layer.name].visible = layer.name in shown
        if cameras:
            handles[CAMERAS].visible = cameras.value

    for box in (which, tint, cameras):
        if box:
            box.on_update(update)


def _fill(live: Any, page: Page) -> dict[str, Any]:
    """Put everything into a server's scene: the node of each layer, and that of all cameras."""
    first = AFTER if page.has_after else BEFORE
    shown = shown_layers(page.layers, first, tinted=False)
    up = -page.camera.rotation[1].detach().double().numpy()
    live.scene.set_up_direction(up)
    handles = {}
    for layer in page.layers:
        splats = page.placed(layer.splats)
        handles[layer.name] = live.scene.add_gaussian_splats(
            f"/{layer.name}", splats.means, splats.covariances, splats.colors,
            splats.opacities[:, None], visible=layer.name in shown,
        )  # fmt: skip
    if page.cameras:
        handles[CAMERAS] = live.scene.add_frame(f"/{CAMERAS}", show_axes=False, visible=False)
        for index, viewpoint in enumerate(page.cameras):
            _add_camera(live, page, f"/{CAMERAS}/{index:04d}", viewpoint.camera)
    _aim(live.initial_camera, page, up)
    return handles


def _add_camera(live: Any, page: Page, name: str, camera: Camera) -> None:
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(camera.rotation.detach().double().numpy().T).as_quat()
    live.scene.add_camera_frustum(
        name, fov=_fov(camera), aspect=camera.width / camera.height,
        scale=page.frustum_length * page.scale, thickness=1.5, thickness_units="screen",
        color=CAMERA_COLOR, wxyz=(w, x, y, z), position=page.point(camera.center),
    )  # fmt: skip


def _aim(view: Any, page: Page, up: np.ndarray) -> None:
    """Let the view begin at the page's camera, and turn about what that sees of the bulk."""
    center, forward = (v.detach().double() for v in (page.camera.center, page.camera.forward))
    ahead = float((torch.tensor(page.center, dtype=torch.float64) - center) @ forward)
    view.position = page.point(center)
    view.look_at = page.point(center + max(ahead, 0.1 * page.radius) * forward)
    view.up = up
    view.fov = _fov(page.camera)
    view.near, view.far = 0.001 * RADIUS, 4 * FARTHEST * RADIUS


def _fov(camera: Camera) -> float:
    """Vertical field of view, radians."""
    return 2 * atan(camera.height / 2 / camera.fy)
