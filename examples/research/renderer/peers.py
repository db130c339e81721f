"""Other renderers, where they are installed: one adapter each.

An adapter takes a workload and returns a function that draws it: `draw(scene, camera)`, a picture
of `h w 3` over black. It runs in a process of its own, because a peer may end its process.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.bench.measure import Timing, timed
from gsedit.bench.renderer.accuracy import Draw, Drawn, differentiate
from gsedit.bench.renderer.speed import Workload
from rasterizer import Camera, Gaussians
from rasterizer.numerics import DEFAULT, SH_DC


@dataclass(frozen=True)
class Peer:
    """Another renderer and its adapter."""

    name: str
    """Name of its package and module."""
    prepare: Callable[[Workload], Draw]
    differentiable: bool = True
    """Whether the adapter gives gradients to torch."""
    remark: str = ""
    """How its picture differs by design."""

    def title(self) -> str:
        """Name and version, where it has one."""
        try:
            return f"{self.name} {version(self.name)}"
        except PackageNotFoundError:
            return self.name


@dataclass(frozen=True, eq=False)
class PeerResult:
    """Times, picture and gradients of a peer."""

    forward: Timing
    both: Timing | None
    drawn: Drawn


def installed() -> tuple[list[Peer], list[str]]:
    """Peers whose modules are installed (they are not imported), and names of the others."""
    present = {name: importlib.util.find_spec(name) is not None for name in PEER_TABLE}
    return (
        [peer for name, peer in PEER_TABLE.items() if present[name]],
        [name for name in PEER_TABLE if not present[name]],
    )


def measure_peer(
    name: str, workload: Workload, runs: int, budget: float, pieces: int
) -> PeerResult:
    """Time a peer and draw with it. Raises what the peer raises."""
    peer = PEER_TABLE[name]
    scene, camera = workload.scene, workload.camera
    drawing = peer.prepare(workload)
    with torch.no_grad():
        drawing(scene, camera)  # the first call also compiles and loads
        forward, picture = timed(lambda: drawing(scene, camera), runs, budget, pieces)
    if not peer.differentiable:
        return PeerResult(forward, None, Drawn(picture, {}))
    both, drawn = timed(lambda: differentiate(drawing, scene, camera), runs, budget, pieces)
    return PeerResult(forward, both, drawn)


def _gsplat(workload: Workload) -> Draw:
    """gsplat.rasterization as its documentation calls it. It needs CUDA: on a CPU it raises."""
    import gsplat  # pyright: ignore[reportMissingImports]

    def draw(scene: Gaussians, camera: Camera) -> Float[Tensor, "h w 3"]:
        colors, _, _ = gsplat.rasterization(
            scene.means,
            scene.quats,
            scene.scales,
            scene.opacities,
            scene.sh,
            camera.world_to_camera[None].to(scene.means),
            intrinsics(camera).to(scene.means)[None],
            camera.width,
            camera.height,
            sh_degree=scene.degree,
        )
        return colors[0]

    return draw


def intrinsics(camera: Camera) -> Float[Tensor, "3 3"]:
    """fx 0 cx; 0 fy cy; 0 0 1."""
    rows = ((camera.fx, 0.0, camera.cx), (0.0, camera.fy, camera.cy), (0.0, 0.0, 1.0))
    return torch.tensor(rows, dtype=torch.float64)


def _opensplat(workload: Workload) -> Draw:
    """OpenSplat's CPU rasterizer: a module built beside gsedit (docs/measurements/renderer.md).

    SH degree 0. Nothing behind the near plane is left out: it clamps what is behind the camera.
    """
    import opensplat_cpu  # pyright: ignore[reportMissingImports]

    if workload.scene.degree:
        raise NotImplementedError(f"SH degree {workload.scene.degree}: 0 only")

    def draw(scene: Gaussians, camera: Camera) -> Float[Tensor, "h w 3"]:
        in_front = (scene.means.detach() @ camera.rotation.T.to(scene.means))[:, 2] + float(
            camera.world_to_camera[2, 3]
        ) > DEFAULT.near
        if not in_front.all():
            scene = scene[in_front]
        return opensplat_cpu.rasterize(
            scene.means,
            scene.scales,
            scene.quats,
            scene.opacities,
            (0.5 + SH_DC * scene.sh[:, 0]).clamp_min(0),
            camera.world_to_camera,
            camera.fx,
            camera.fy,
            camera.cx,
            camera.cy,
            camera.width,
            camera.height,
        )

    return draw


def _mitsuba(workload: Workload) -> Draw:
    """Mitsuba's ellipsoids under its volprim_rf_basic integrator, one sample in a pixel's center.

    The scene is built once, as an optimisation would: the times are of rendering alone.
    """
    import drjit  # pyright: ignore[reportMissingImports]
    import mitsuba as mi  # pyright: ignore[reportMissingImports]

    mi.set_variant("llvm_ad_rgb")  # the integrator exists only where there are derivatives
    drjit.set_thread_count(torch.get_num_threads())
    stage = mi.load_dict(mitsuba_scene(mi, workload))

    def draw(_: Gaussians, camera: Camera) -> Float[Tensor, "h w 3"]:
        picture = np.array(mi.render(stage, spp=1))[..., :3]
        return torch.from_numpy(np.ascontiguousarray(picture, dtype=np.float32))

    return draw


def mitsuba_scene(mi: Any, workload: Workload) -> dict[str, Any]:
    """The workload for mitsuba.load_dict, whose camera looks along z with x to the left, y up."""
    scene, camera = workload.scene, workload.camera
    flip = torch.diag(torch.tensor((-1.0, -1.0, 1.0, 1.0), dtype=torch.float64))
    to_world = torch.linalg.inv(camera.world_to_camera.double()) @ flip
    quats = torch.nn.functional.normalize(scene.quats, dim=1)[:, (1, 2, 3, 0)]  # xyzw
    fov_x = 2 * np.degrees(np.arctan(camera.width / (2 * camera.fx)))

    def tensor(values: Tensor) -> Any:
        return mi.TensorXf(values.detach().float().contiguous().numpy())

    return {
        "type": "scene",
        "integrator": {"type": "volprim_rf_basic", "max_depth": 4096, "srgb_primitives": False},
        "sensor": {
            "type": "perspective",
            "fov": float(fov_x),
            "fov_axis": "x",
            "principal_point_offset_x": 0.5 - camera.cx / camera.width,
            "principal_point_offset_y": 0.5 - camera.cy / camera.height,
            "near_clip": DEFAULT.near,
            "to_world": mi.ScalarTransform4f(to_world.numpy()),
            "film": {
                "type": "hdrfilm",
                "width": camera.width,
                "height": camera.height,
                "rfilter": {"type": "box"},
                "pixel_format": "rgb",
            },
            "sampler": {"type": "independent"},
        },
        "primitives": {
            "type": "ellipsoids",
            "centers": tensor(scene.means),
            "scales": tensor(scene.scales),
            "quaternions": tensor(quats),
            "opacities": tensor(scene.opacities[:, None]),
            "sh_coeffs": tensor(scene.sh.flatten(1)),
        },
    }


PEER_TABLE: dict[str, Peer] = {
    "gsplat": Peer("gsplat", _gsplat),
    "opensplat_cpu": Peer("opensplat_cpu", _opensplat),
    "mitsuba": Peer(
        "mitsuba",
        _mitsuba,
        differentiable=False,
        remark="traces rays: no low-pass filter, and it orders Gaussians by where a ray enters, so "
        "its error is mostly that of another model; forward only here",
    ),
}
