"""Stiff and extreme scenes for the renderer, each with the reason why it is here; drawn: which are
finite, which are refused, and their errors.

Most are one extreme Gaussian among 200 ordinary ones, which it must not affect. Pictures are
small, so that the float64 reference is fast, and drawn without the early stop, so that errors are
rounding and nothing else. Nothing is drawn from a global generator.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import groupby
from math import inf, log, nan, sqrt
from typing import Literal, NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.bench.renderer.accuracy import differentiate, errors, with_pose
from gsedit.bench.results import markdown_table
from gsedit.run.events import Event
from gsedit.run.stopwatch import Stopwatch
from rasterizer.camera import Camera, look_at
from rasterizer.numerics import AUTO, DEFAULT, SH_DC, Execution, Numerics
from rasterizer.reference import render_reference
from rasterizer.render import render
from rasterizer.scene import Gaussians, concatenate

CROWD = 200
DIAGONAL = (0.9238795325112867, 0.0, 0.0, 0.3826834323650898)
"""Quaternion of 45 degrees about the view."""
FAR = 1e7
"""Distance at which float32 resolves one unit: map coordinates of a scene never moved, meters."""


class RenderInput(NamedTuple):
    """The arguments of a render."""

    scene: Gaussians
    camera: Camera
    background: Float[Tensor, " 3"]


@dataclass(frozen=True)
class EdgeCase:
    """One scene, and what must happen to it."""

    name: str
    why: str
    make: Callable[[torch.dtype], RenderInput]
    refused: str | None = None
    """The input that a ValueError must name; None: must be drawn."""


def camera(width: int = 40, height: int = 32, focal: float = 40.0) -> Camera:
    """At the origin along +z, with a principal point off the middle: symmetry hides mistakes."""
    pose = torch.eye(4, dtype=torch.float64)
    return Camera(pose, focal, 1.05 * focal, 0.52 * width, 0.47 * height, width, height)


def gaussian(
    mean: tuple[float, float, float],
    scales: tuple[float, float, float] | float = 0.1,
    quat: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0),
    opacity: float = 0.7,
    color: tuple[float, float, float] = (0.8, 0.4, 0.2),
) -> Gaussians:
    """A scene of one row, degree 0, float64."""
    return Gaussians(
        means=torch.tensor([mean], dtype=torch.float64),
        quats=torch.tensor([quat], dtype=torch.float64),
        log_scales=torch.tensor(scales, dtype=torch.float64).expand(1, 3).log(),
        logit_opacities=torch.tensor([opacity], dtype=torch.float64).logit(),
        sh=((torch.tensor([[color]], dtype=torch.float64) - 0.5) / SH_DC),
    )


def random_cloud(n: int, seed: int, degree: int = 0) -> Gaussians:
    """`n` before `camera()`, float64: all orientations, ratios up to 30, opacity 0.1 to 0.95."""
    generator = torch.Generator().manual_seed(seed)

    def normal(*shape: int) -> Tensor:
        return torch.randn(shape, generator=generator, dtype=torch.float64)

    def uniform(low: float, high: float, *shape: int) -> Tensor:
        draw = torch.rand(shape, generator=generator, dtype=torch.float64)
        return low + (high - low) * draw

    z = uniform(2.0, 6.0, n, 1)
    sh = 0.3 * normal(n, (degree + 1) ** 2, 3)
    sh[:, 0] = uniform(-1.0, 1.0, n, 3)
    opacities = uniform(0.1, 0.95, n)
    return Gaussians(
        means=torch.cat((uniform(-0.6, 0.6, n, 2) * z, z), -1),
        quats=normal(n, 4),
        log_scales=uniform(log(0.01), log(0.3), n, 3),
        logit_opacities=opacities.logit(),
        sh=sh,
    )


def over_background(scene: Gaussians, view: Camera | None = None) -> RenderInput:
    """A background of three different levels makes a wrong transmittance visible."""
    return RenderInput(scene, view or camera(), scene.means.new_tensor((0.2, 0.5, 0.9)))


def _crowd() -> Gaussians:
    return random_cloud(CROWD, seed=3, degree=1)


def _among(extreme: Gaussians) -> Gaussians:
    """The crowd with extreme rows (degree 0) in its middle."""
    padded = extreme.sh.new_zeros(len(extreme), 4, 3)
    padded[:, :1] = extreme.sh
    crowd, half = _crowd(), CROWD // 2
    return concatenate(crowd[:half], replace(extreme, sh=padded), crowd[half:])


def _in_dtype(
    build: Callable[[], Gaussians], view: Camera | None = None
) -> Callable[[torch.dtype], RenderInput]:
    """A scene that is the same in every dtype, but for rounding."""
    return lambda dtype: over_background(build().to(dtype), view)


def _one(name: str, why: str, extreme: Gaussians, view: Camera | None = None) -> EdgeCase:
    """One extreme Gaussian in the crowd."""
    return EdgeCase(name, why, _in_dtype(lambda: _among(extreme), view))


def _bad_value(name: str, value: float) -> EdgeCase:
    """One number of one input replaced, far from the first row."""

    def make(dtype: torch.dtype) -> RenderInput:
        values = getattr(_crowd(), name).clone()
        values.view(CROWD, -1)[57, -1] = value
        return over_background(replace(_crowd(), **{name: values}).to(dtype))

    why = "a diverged optimizer or a broken file; must be named, not drawn or dropped"
    return EdgeCase(f"{name} {value}", why, make, refused=rf"{name}\[57")


def _bad_camera(name: str, value: float) -> EdgeCase:
    def make(dtype: torch.dtype) -> RenderInput:
        view, bad = camera(), value
        if name == "world_to_camera":
            bad = view.world_to_camera.clone()
            bad[1, 3] = value
        return over_background(_crowd().to(dtype), replace(view, **{name: bad}))

    why = "no comparison with NaN is true: an empty picture would hide it"
    return EdgeCase(f"camera.{name} {value}", why, make, refused=rf"camera\.{name}")


def _bad_background(value: float) -> EdgeCase:
    def make(dtype: torch.dtype) -> RenderInput:
        good = over_background(_crowd().to(dtype))
        bad = good.background.clone()
        bad[1] = value
        return good._replace(background=bad)

    why = "it would reach every pixel"
    return EdgeCase(f"background {value}", why, make, refused="background")


def _tiny_quat(dtype: torch.dtype) -> RenderInput:
    """Make a denormal quaternion: which numbers are denormal depends on the dtype."""
    small = torch.finfo(dtype).smallest_normal / 64
    scene = _among(gaussian((0.1, 0.0, 2.0), (0.4, 0.05, 0.1))).to(dtype)
    scene.quats[CROWD // 2] = scene.quats.new_tensor((2.0, -1.0, 3.0, 1.0)) * small
    return over_background(scene)


def _quat(norm: float) -> Gaussians:
    """A rotation that is not the identity, as a quaternion of that norm."""
    unit = (0.5, -0.5, 0.1, 0.7)
    turned = tuple(norm / sqrt(sum(q * q for q in unit)) * q for q in unit)
    return gaussian((0.1, 0.0, 2.0), (0.4, 0.05, 0.1), (turned[0], turned[1], turned[2], turned[3]))


def _far_away(dtype: torch.dtype) -> RenderInput:
    """The crowd, 100 times as large, 1e7 from the origin; the camera looks along no axis."""
    crowd, shift = _crowd(), torch.tensor((FAR, -FAR, FAR), dtype=torch.float64)
    scene = replace(crowd, means=100 * crowd.means + shift, log_scales=crowd.log_scales + log(100))
    position, target = (
        torch.tensor((x, -60.0, z), dtype=torch.float64) for x, z in ((90.3, -70.7), (0, 400))
    )
    up = torch.tensor((0.2, -1.0, 0.0), dtype=torch.float64)
    return over_background(
        scene.to(dtype), look_at(position + shift, target + shift, up, 45.0, 40, 32)
    )


def _telescope(dtype: torch.dtype) -> RenderInput:
    """The principal point lies half a million pixels beside the picture."""
    extreme = gaussian((1.0, 0.0, 2.0), (1e-5, 2e-5, 1e-6), DIAGONAL)
    return over_background(_among(extreme).to(dtype), replace(camera(focal=1e6), cx=20.3 - 5e5))


def _from_aside(dtype: torch.dtype) -> RenderInput:
    """Depths that differ by less than float32 resolves; the camera looks along no axis."""
    position = torch.tensor((3.0, -2.0, -1.0))
    view = look_at(
        position, torch.tensor((0.0, 0.0, 4.0)), torch.tensor((0.0, -1.0, 0.0)), 50.0, 40, 32
    )
    layers = [
        gaussian((0.0, 0.0, 4 + 1e-8 * i), (0.3, 0.3, 0.3), opacity=0.3, color=(i / 40, 0.5, 0.2))
        for i in range(40)
    ]
    return over_background(_among(concatenate(*layers)).to(dtype), view)


def _coincident() -> Gaussians:
    colors = _crowd()[torch.arange(10_000) % CROWD]
    return replace(
        colors,
        means=torch.tensor((0.02, -0.01, 2.0), dtype=torch.float64).repeat(10_000, 1),
        logit_opacities=torch.linspace(-8, -4, 10_000, dtype=torch.float64),
    )


def _layers() -> Gaussians:
    count = 100_000
    colors = _crowd()[torch.arange(count) % CROWD]
    depth = torch.linspace(2, 4, count, dtype=torch.float64)
    return replace(
        colors,
        means=torch.stack((0.01 * depth, torch.zeros_like(depth), depth), -1),
        quats=torch.tensor((1.0, 0, 0, 0), dtype=torch.float64).repeat(count, 1),
        log_scales=torch.tensor((-1.0, -1.2, -1.5), dtype=torch.float64).repeat(count, 1),
        logit_opacities=torch.full((count,), -4.5, dtype=torch.float64),
    )


def _moved(change: Callable[[Tensor], Tensor]) -> Callable[[torch.dtype], RenderInput]:
    """The crowd with other positions."""
    return _in_dtype(lambda: replace(_crowd(), means=change(_crowd().means)))


def _logit(value: float) -> Gaussians:
    extreme = gaussian((0.1, 0.0, 2.0), (0.3, 0.2, 0.1))
    return replace(extreme, logit_opacities=torch.tensor([value], dtype=torch.float64))


def _near(offset: float) -> Gaussians:
    return gaussian((1e-3, 0.0, DEFAULT.near + offset), 1e-3)


def _strip(tall: bool) -> Callable[[torch.dtype], RenderInput]:
    """The crowd spread along a line of pixels."""
    width, height = (1, 1024) if tall else (1024, 1)
    stretch = torch.tensor((0.01, 1.0, 1.0) if tall else (1.0, 0.01, 1.0), dtype=torch.float64)

    def line() -> Gaussians:
        return replace(_crowd(), means=_crowd().means * stretch)

    return _in_dtype(line, camera(width, height, focal=875.0))


EDGE_CASES: tuple[EdgeCase, ...] = (
    EdgeCase("ordinary crowd", "what the errors of the others compare to", _in_dtype(_crowd)),
    _one("behind the camera", "its mirror image must not show", gaussian((0.1, 0.1, -2.0))),
    _one("in the camera's plane", "z = 0 divides", gaussian((0.1, 0.0, 0.0))),
    _one("at the near plane", "not drawn: its depth must be greater", _near(0.0)),
    _one("1e-6 beyond the near plane", "drawn, 250 times as large as from afar", _near(1e-6)),
    _one("1e-6 before the near plane", "not drawn; the crowd is", _near(-1e-6)),
    _one(
        "grazing", "seen only by its footprint; the Jacobian's limit decides",
        gaussian((2.0, 0.0, 0.25), (1.0, 1.0, 1.0)),
    ),
    _one("1e20 before the camera", "the square of its distance is no float32; its direction is",
         gaussian((1e19, 0.0, 1e20), 1e16)),
    _one("color 1e30", "its gradients are as large",
         gaussian((0.1, 0.0, 2.0), (0.3, 0.2, 0.1), color=(1e30, 0.0, 1e-30))),
    _one("scale 1e-12", "a square below every float32", gaussian((0.1, 0.0, 2.0), 1e-12)),
    _one("scale 0", "log-scale -inf: a point, kept in sight by the blur",
         gaussian((0.1, 0.0, 2.0), 0.0)),
    _one("scale 1e6", "determinants of 1e29 pixels^4", gaussian((0.1, 0.0, 2.0), 1e6)),
    _one("scale 1e12", "the determinant overflows float32, the covariance does not",
         gaussian((0.1, 0.0, 2.0), 1e12)),
    _one("scale 1e6 far aside", "its center is 2e7 pixels off the picture",
         gaussian((1e6, 3e5, 2.0), 1e6)),
    _one("scales 1e-12 to 1e6", "sizes of 18 orders of magnitude in one Gaussian",
         gaussian((0.1, 0.0, 2.0), (1e-12, 1e6, 1e4), (0.9, 0.3, -0.2, 0.1))),
    _one("covers the screen", "touches every tile", gaussian((0.0, 0.0, 2.0), (20.0, 20.0, 0.1))),
    _one("needle 1 : 1e-6", "drawn as wide as the blur",
         gaussian((0.0, 0.0, 2.0), (1.0, 1e-6, 1e-6), DIAGONAL, 0.95)),
    _one("needle 1e3 : 1e-3", "20,000 pixels long: the conic's determinant is a difference of "
         "equals", gaussian((0.1, 0.0, 2.0), (1e3, 1e-3, 1e-3), DIAGONAL, 0.95)),
    _one(
        "needle of 1000 pixels", "diagonal and larger than the picture: terms cancel by 1e6",
        gaussian((0.003, 0.0, 2.0), (0.35, 3.5e-7, 3.5e-7), DIAGONAL, 0.95),
        camera(160, 160, focal=2000.0),
    ),
    _one("needle end on", "points at the camera: a disc of no area before the blur",
         gaussian((0.0, 0.0, 2.0), (1e-6, 1e-6, 1.0))),
    _one("disc", "faces the camera, ratio 1e6", gaussian((0.0, 0.0, 2.0), (0.5, 0.5, 5e-7))),
    _one("disc edge on", "a line on the picture, ratio 1e6",
         gaussian((0.0, 0.0, 2.0), (0.5, 5e-7, 0.5), DIAGONAL)),
    _one("opacity 0", "logit -inf: nothing, and no log of 0", _logit(-inf)),
    _one("opacity 1 - 1e-7", "the cap holds it at 0.99, without gradient", _logit(-log(1e-7))),
    _one("opacity 1", "logit inf", _logit(inf)),
    _one("logit 50", "1 - opacity is 0 in every dtype", _logit(50.0)),
    _one("logit -50", "far below the floor of alpha", _logit(-50.0)),
    EdgeCase("all of opacity 1", "every alpha at the cap near its center",
             _in_dtype(lambda: replace(_crowd(), logit_opacities=_crowd().logit_opacities + inf))),
    _one("zero quaternion", "the identity, without gradient",
         gaussian((0.1, 0.0, 2.0), (0.4, 0.05, 0.1), (0.0, 0.0, 0.0, 0.0))),
    EdgeCase("denormal quaternion", "its square is 0, its direction is not; its gradient would "
             "overflow float32, and is 0", _tiny_quat),
    _one("quaternion of norm 1e-30", "its square underflows float32", _quat(1e-30)),
    _one("quaternion of norm 1e3", "files may hold quaternions that are not normalised",
         _quat(1e3)),
    _one("quaternion of norm 1e30", "its square overflows float32", _quat(1e30)),
    EdgeCase("1e7 from the origin", "scene and camera both: positions cancel", _far_away),
    EdgeCase("depths 1e-8 apart", "float32 depth would draw them in another order", _from_aside),
    EdgeCase("10,000 coincident", "equal depths keep the order of the file",
             _in_dtype(_coincident)),
    EdgeCase("100,000 layers", "deep in one pixel: the transmittance falls to 0",
             _in_dtype(_layers, camera(1, 1, focal=1.0))),
    EdgeCase("positions twice", "two Gaussians at each position, as in real captures: the sort is "
             "stable", _moved(lambda means: means[torch.arange(CROWD) // 2 * 2])),
    EdgeCase("focal length 1", "all on one pixel", _in_dtype(_crowd, camera(focal=1.0))),
    EdgeCase("focal length 1e6", "a picture of 4e-5 radians beside the axis: float32 rounds x/z by "
             "a tenth of a pixel", _telescope),
    EdgeCase("1 x 1 pixel", "less than a tile", _in_dtype(_crowd, camera(1, 1, focal=1.0))),
    EdgeCase("1024 x 1 pixels", "a row of tiles that are empty but for one line of pixels",
             _strip(tall=False)),
    EdgeCase("1 x 1024 pixels", "a column of tiles that are empty but for one line of pixels",
             _strip(tall=True)),
    EdgeCase("empty scene", "the background, and no error", _in_dtype(lambda: _crowd()[:0])),
    EdgeCase("nothing visible", "backward must still work", _moved(lambda means: -means)),
    *(_bad_value(name, value) for name in ("means", "quats", "sh") for value in (nan, inf, -inf)),
    *(_bad_value("log_scales", value) for value in (nan, inf, 1e3)),
    _bad_value("logit_opacities", nan),
    *(
        _bad_camera(name, value)
        for name in ("world_to_camera", "fx", "fy", "cx", "cy")
        for value in (nan, inf)
    ),
    *(_bad_background(value) for value in (nan, inf)),
)  # fmt: skip


Outcome = Literal["finite", "refused", "not finite"]
WITHOUT_STOP = Numerics(transmittance_min=0.0)


@dataclass(frozen=True)
class EdgeCaseMeasurement:
    """One edge case in one dtype. None: not measured, or not finite."""

    name: str
    why: str
    dtype: str
    outcome: Outcome
    """Outcome of the picture and of all its gradients."""
    message: str = ""
    """The ValueError's text where it was refused."""
    image_error: float | None = None
    """Largest error of a color, against the float64 reference of the same rounded inputs; in
    units of the brightest color where that is above 1."""
    gradient_error: float | None = None
    """Relative L2 error of the worst input, the pose among them."""


def measurements() -> Iterator[Event | EdgeCaseMeasurement]:
    """Every edge case in float32, then in float64, and an event that names each."""
    stopwatch = Stopwatch()
    for step, case in enumerate(EDGE_CASES, 1):
        yield from (measure_edge_case(case, dtype) for dtype in (torch.float32, torch.float64))
        yield Event("stability", stopwatch.seconds, step, len(EDGE_CASES), note=case.name)


def measure_edge_case(
    case: EdgeCase, dtype: torch.dtype, execution: Execution = AUTO
) -> EdgeCaseMeasurement:
    """Draw one edge case with the rasterizer, and by the textbook in float64, with gradients."""
    scene, camera, background = case.make(dtype)
    row = EdgeCaseMeasurement(case.name, case.why, str(dtype).removeprefix("torch."), "refused")
    options = {"background": background, "numerics": WITHOUT_STOP, "execution": execution}

    def draw(scene: Gaussians, camera: Camera) -> Float[Tensor, "h w 3"]:
        return render(scene, camera, **options).color

    def exactly(scene: Gaussians, camera: Camera) -> Float[Tensor, "h w 3"]:
        return render_reference(scene, camera, background=background.double()).color

    try:
        drawn = with_pose(differentiate(draw, scene, camera), draw, scene, camera)
    except ValueError as error:
        return replace(row, message=str(error))
    reference = differentiate(exactly, scene.to(torch.float64), camera, pose=True)
    wrong, brightest = errors(drawn, reference), max(1.0, float(reference.picture.abs().max()))
    parts: list[Tensor] = [drawn.picture, *drawn.gradients.values()]
    if not all(part.isfinite().all() for part in parts):
        return replace(row, outcome="not finite")
    image, gradient = wrong.largest / brightest, wrong.gradient
    return replace(row, outcome="finite", image_error=image, gradient_error=gradient)


def table(rows: Iterable[EdgeCaseMeasurement]) -> str:
    """Markdown: the cases that are drawn, with their errors; then the refused, with messages."""
    lines, refused = [], []
    for _, group in groupby(rows, key=lambda row: row.name):
        measured = list(group)
        first, cells = measured[0], []
        for row in measured:
            values = (row.image_error, row.gradient_error)
            cells += [f"**{row.outcome}**" if each is None else f"{each:.1e}" for each in values]
        if first.outcome == "refused":
            refused.append(f"- {first.name} ({first.why}): {first.message}")
        else:
            lines.append([f"**{first.name}**: {first.why}", *cells])
    parts = [_LEGEND, markdown_table(HEAD, lines)]
    if refused:
        parts += ["Refused, each by a ValueError:", "\n".join(refused)]
    return "\n\n".join(parts)


HEAD = ("", "float32 image", "float32 gradients", "float64 image", "float64 gradients")
_LEGEND = (
    "Errors against the float64 reference of the same inputs: the largest of a color (in units of "
    "the brightest where that is above 1), and the relative L2 error of the worst gradient, pose "
    "included."
)
