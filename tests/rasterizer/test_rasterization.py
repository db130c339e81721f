"""`rasterization` draws what the reference draws, by gsplat's names and conventions."""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from inspect import unwrap
from math import ceil, exp, log, sqrt

import pytest
import torch
from closeness import leaves, relative, tensors, weights_like
from scenes import camera, gaussian, random_cloud

from rasterizer import Camera, Execution, Gaussians, Numerics, rasterization, render
from rasterizer.harmonics import without_zero_bands
from rasterizer.numerics import SH_DC
from rasterizer.project import rotation_matrices
from rasterizer.reference import render_reference

DTYPES = [torch.float64, torch.float32]
BACKGROUND = torch.tensor((0.2, 0.5, 0.9), dtype=torch.float64)


def ortho() -> Camera:
    """Eight pixels a unit: the cloud's spread fills the picture."""
    return replace(camera(), fx=8.0, fy=8.4, model="ortho")


# option: gsplat's arguments; the same as Numerics; the camera
OPTIONS = {
    "classic": ({}, {}, camera()),
    "near": ({"near_plane": 3.0}, {"near": 3.0}, camera()),
    "far": ({"far_plane": 4.0}, {"far": 4.0}, camera()),
    "eps2d": ({"eps2d": 1.5}, {"blur": 1.5}, camera()),
    "radius_clip": ({"radius_clip": 5.0}, {"radius_clip": 5.0}, camera()),
    "antialiased": ({"rasterize_mode": "antialiased"}, {"antialiased": True}, camera()),
    "ortho": ({"camera_model": "ortho"}, {}, ortho()),
    "ortho from behind": (
        {"camera_model": "ortho", "near_plane": -100.0, "far_plane": -3.5},
        {"near": -100.0, "far": -3.5},
        replace(ortho(), world_to_camera=torch.diag(torch.tensor([1.0, -1, -1, 1])).double()),
    ),
    "all": (
        {
            "near_plane": 2.5,
            "far_plane": 5.5,
            "eps2d": 0.1,
            "radius_clip": 3.0,
            "rasterize_mode": "antialiased",
        },
        {"near": 2.5, "far": 5.5, "blur": 0.1, "radius_clip": 3.0, "antialiased": True},
        camera(),
    ),
}


def cloud(degree: int = 2) -> Gaussians:
    """Sparse: no tile is finished, so that every picture here is the whole sum."""
    return random_cloud(60, seed=3, degree=degree)


def by_name(scene: Gaussians, *views: Camera) -> dict[str, object]:
    """gsplat's arguments for a scene with harmonics, in the scene's dtype."""
    first = views[0]
    intrinsics = [[[v.fx, 0, v.cx], [0, v.fy, v.cy], [0, 0, 1]] for v in views]
    return {
        "means": scene.means,
        "quats": scene.quats,
        "scales": scene.scales,
        "opacities": scene.opacities,
        "colors": scene.sh,
        "viewmats": torch.stack([v.world_to_camera for v in views]).to(scene.means),
        "Ks": torch.tensor(intrinsics, dtype=scene.means.dtype),
        "width": first.width,
        "height": first.height,
        "sh_degree": scene.degree,
    }


def loss_of(color: torch.Tensor, alpha: torch.Tensor) -> torch.Tensor:
    return (color * weights_like(color)).sum() + (alpha * weights_like(alpha, 1)).sum()


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("option", OPTIONS)
def test_every_option_is_the_references(option, dtype):
    arguments, meaning, view = OPTIONS[option]
    scene, numerics = cloud().to(dtype), Numerics(**meaning)
    wanted = render_reference(scene, view, background=BACKGROUND, numerics=numerics)
    drawn = render(scene, view, background=BACKGROUND, depth=True, numerics=numerics)
    color, alpha, _ = rasterization(
        **by_name(scene, view),
        **arguments,
        backgrounds=BACKGROUND.to(dtype)[None],
        render_mode="RGB+ED",
    )
    assert color.dtype == dtype
    assert (color[0, ..., :3] - drawn.color).abs().max() < 4e-6  # opacity is not a logit here
    for found, depth in ((drawn.color, drawn.depth), (color[0, ..., :3], color[0, ..., 3])):
        error = (found.double() - wanted.color).abs()
        # in float32 a splat whose alpha rounds to the other side of the floor is there or not
        flips = error > (1e-9 if dtype == torch.float64 else 1e-4)
        assert flips.double().mean() <= (0 if dtype == torch.float64 else 2e-3)
        assert error[~flips].mean() < 1e-5
        apart = (depth.double() - wanted.depth).abs()[~flips.any(-1)]
        # alpha is at least 1/255, and known to one rounding of 1: depth 6 / alpha loses 255 of them
        assert apart.max() < 6 * 255 * torch.finfo(dtype).eps * 2
    assert 0.02 < alpha.mean() < alpha.max() < 1 - 1e-5


def test_every_option_changes_the_picture():
    plain = render_reference(cloud(), camera()).color
    for name, (_, meaning, view) in OPTIONS.items():
        changed = render_reference(cloud(), view, numerics=Numerics(**meaning)).color
        assert (name == "classic") == bool((changed - plain).abs().max() < 1e-3), name


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("option", OPTIONS)
def test_gradients_of_every_option_are_the_references(option, dtype):
    arguments, meaning, view = OPTIONS[option]
    scene, numerics = cloud().to(dtype), Numerics(**meaning)

    def gradients(draw, scene):
        inputs = leaves(scene)
        pose = view.world_to_camera.clone().to(dtype).requires_grad_()
        background = BACKGROUND.clone().to(dtype).requires_grad_()
        color, alpha = draw(inputs, replace(view, world_to_camera=pose), background)
        return torch.autograd.grad(loss_of(color, alpha), (*tensors(inputs), pose, background))

    def reference(scene, view, background):
        found = render_reference(scene, view, background=background, numerics=numerics)
        return found.color, found.alpha

    def ours(scene, view, background):
        found = render(scene, view, background=background, numerics=numerics)
        return found.color, found.alpha

    def theirs(scene, view, background):
        color, alpha, _ = rasterization(
            **by_name(scene, view), **arguments, backgrounds=background[None]
        )
        return color[0], alpha[0, ..., 0]

    wanted = gradients(reference, scene.to(torch.float64))
    bar = 1e-3 if dtype == torch.float32 else 1e-8  # as tests/test_render.py
    for draw in (ours, theirs):
        for a, b in zip(gradients(draw, scene), wanted):
            assert relative(a, b) < bar


@pytest.mark.parametrize("mode", ["classic", "antialiased"])
@pytest.mark.parametrize("columns", [6, 9])
def test_covars_are_quats_and_scales(columns, mode):
    scene = leaves(cloud())
    arguments = by_name(scene, camera())
    axes = rotation_matrices(scene.quats) * scene.scales[:, None, :]
    covars = axes @ axes.mT
    if columns == 6:
        covars = covars[:, (0, 0, 0, 1, 1, 2), (0, 1, 2, 1, 2, 2)]
    given = arguments | {"quats": None, "scales": None, "covars": covars}
    pictures = [rasterization(**a, rasterize_mode=mode)[0] for a in (arguments, given)]
    assert (pictures[0] - pictures[1]).abs().max() < 1e-9
    of = (scene.quats, scene.log_scales)
    wanted, found = (torch.autograd.grad(loss_of(p, p), of, retain_graph=True) for p in pictures)
    for a, b in zip(found, wanted):
        assert relative(a, b) < 1e-8


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("mode", ["classic", "antialiased"])
def test_covars_may_be_singular(mode, dtype):
    """A point, a line and a disc have no Cholesky factor of full rank."""
    scene = random_cloud(3, seed=8)
    flat = torch.tensor([[0.0, 0, 0], [0.3, 0, 0], [0.3, 0.2, 0]], dtype=torch.float64)
    axes = rotation_matrices(scene.quats) * flat[:, None, :]
    scene = scene.to(dtype)
    arguments = by_name(scene, camera()) | {"scales": flat.to(dtype), "rasterize_mode": mode}
    covars = (axes @ axes.mT).to(dtype).requires_grad_()
    means = scene.means.clone().requires_grad_()
    wanted, _, _ = rasterization(**arguments)
    found, _, _ = rasterization(**arguments | {"covars": covars, "means": means})
    eps = torch.finfo(dtype).eps
    # exponents up to 5.5 of covariances of condition 100 (6 pixels long, blurred by 0.3); of
    # antialiased lines the visible part is the root of a determinant that is 0 but for rounding
    bar = sqrt(eps) if mode == "antialiased" else 5.5 * 100 * eps
    assert (found - wanted).abs().max() < bar
    loss_of(found, found).backward()
    assert covars.grad is not None
    assert covars.grad.isfinite().all()
    assert covars.grad[1:].abs().sum() > 0
    assert means.grad is not None
    assert means.grad.isfinite().all()


def test_gradcheck_of_covars():
    scene = random_cloud(4, seed=5)
    view = camera(9, 7, focal=8.0)
    arguments = by_name(replace(scene, logit_opacities=torch.zeros(4).double()), view)
    axes = rotation_matrices(scene.quats) * (scene.scales + 0.2)[:, None, :]
    covars = (axes @ axes.mT).requires_grad_()

    def picture(covars):
        return rasterization(**arguments, covars=covars, rasterize_mode="antialiased")[0]

    assert torch.autograd.gradcheck(picture, (covars,), fast_mode=True)


@pytest.mark.parametrize("channels", [1, 2, 7, 32])
def test_features_of_any_number_of_channels(channels):
    scene, view = cloud(0), camera()
    generator = torch.Generator().manual_seed(channels)
    features = torch.rand(60, channels, generator=generator, dtype=torch.float64)
    arguments = by_name(scene, view) | {"colors": features, "sh_degree": None}
    color, _, _ = rasterization(**arguments)
    assert color.shape == (1, 32, 40, channels)
    padded = torch.nn.functional.pad(features, (0, -channels % 3))
    for i, columns in enumerate(padded.split(3, dim=1)):
        painted = replace(scene, sh=((columns - 0.5) / SH_DC)[:, None])
        wanted = render_reference(painted, view).color[..., : channels - 3 * i]
        assert (color[0, ..., 3 * i : 3 * i + 3] - wanted).abs().max() < 1e-9


def test_features_may_be_negative():
    scene = cloud(0)
    features = torch.linspace(-3, 2, 120, dtype=torch.float64).view(60, 2)
    arguments = by_name(scene, camera()) | {"sh_degree": None}
    up, _, _ = rasterization(**arguments | {"colors": features})
    down, _, _ = rasterization(**arguments | {"colors": -features})
    assert up.min() < -0.1
    assert torch.equal(up, -down)


@pytest.mark.parametrize("degree", range(5))
def test_harmonics_up_to_a_degree(degree):
    scene = random_cloud(60, seed=3, degree=4)
    cut = replace(scene, sh=scene.sh[:, : (degree + 1) ** 2])
    color, _, _ = rasterization(**by_name(scene, camera()) | {"sh_degree": degree})
    assert (color[0] - render_reference(cut, camera()).color).abs().max() < 1e-9


@dataclass(frozen=True, eq=False)
class Watched(Camera):
    """Keeps the centres on the picture that the reference computes, in depth order."""

    def project(self, points):
        xy, z = super().project(points)
        xy.retain_grad()
        CENTRES[:] = [xy]
        return xy, z


CENTRES: list[torch.Tensor] = []


def test_means2d_takes_the_gradient_of_the_centres_on_the_picture():
    scene = leaves(cloud())
    color, alpha, meta = rasterization(**by_name(scene, camera()))
    meta["means2d"].retain_grad()  # as gsplat's users write
    loss_of(color[0], alpha[0, ..., 0]).backward()
    view = camera()
    found = render_reference(leaves(cloud()), Watched(**vars(view)))
    loss_of(found.color, found.alpha).backward()
    wanted = torch.empty_like(scene.means[:, :2])
    wanted[scene.means[:, 2].argsort()] = CENTRES[0].grad
    assert meta["means2d"].grad.shape == (1, 60, 2)
    assert relative(meta["means2d"].grad[0], wanted) < 1e-8


def test_meta_serves_densification():
    """What gsplat's default strategy reads after a backward pass with packed=False."""
    scene = leaves(cloud().to(torch.float32))
    views = camera(), replace(camera(), cx=30.0)
    color, _, meta = rasterization(**by_name(scene, *views), packed=False)
    color.sum().backward()
    grads = meta["means2d"].grad.clone()
    grads[..., 0] *= meta["width"] / 2 * meta["n_cameras"]
    grads[..., 1] *= meta["height"] / 2 * meta["n_cameras"]
    seen = (meta["radii"] > 0).all(-1)
    assert meta["radii"].shape == (2, 60, 2)
    assert meta["radii"].dtype == torch.int32
    assert 10 < seen[0].sum() < 60
    assert (grads[seen].norm(dim=-1) > 0).float().mean() > 0.8  # the others are hidden, or miss
    assert not grads[~seen].any()
    assert meta["gaussian_ids"] is None


def test_one_gaussian_by_hand():
    """gsplat's conventions: pixel centres at +0.5, conics xx xy yy, radii by opacity."""
    z, sigma, opacity = 2.0, 0.1, 0.7
    scene = gaussian((0.2, -0.1, z), (sigma,) * 3, opacity=opacity)
    arguments = by_name(scene, Camera(torch.eye(4), 50.0, 50.0, 10.0, 8.0, 20, 16))
    x, y = 50 * 0.2 / z + 10, -50 * 0.1 / z + 8
    # an isotropic one seen off the axis: J J^T has the slopes in it
    slope_x, slope_y, scale = 0.1, -0.05, (50 * sigma / z) ** 2
    xx, xy, yy = (1 + slope_x**2) * scale, slope_x * slope_y * scale, (1 + slope_y**2) * scale
    for blur, mode in ((0.3, "classic"), (0.1, "antialiased")):
        color, alpha, meta = rasterization(
            **arguments, eps2d=blur, rasterize_mode=mode, render_mode="RGB+D"
        )
        a, b = xx + blur, yy + blur
        determinant = a * b - xy * xy
        factor = sqrt((xx * yy - xy * xy) / determinant) if mode == "antialiased" else 1.0
        dx, dy = 12.5 - x, 9.5 - y
        conic = (b / determinant, -xy / determinant, a / determinant)
        power = (conic[0] * dx * dx + 2 * conic[1] * dx * dy + conic[2] * dy * dy) / 2
        expected = opacity * factor * exp(-power)
        assert meta["means2d"][0, 0].tolist() == pytest.approx([x, y])
        assert meta["depths"][0, 0].item() == pytest.approx(z)
        assert meta["conics"][0, 0].tolist() == pytest.approx(conic)
        assert meta["opacities"][0, 0].item() == pytest.approx(opacity * factor)
        cut_off = sqrt(2 * log(255 * opacity * factor))
        assert meta["radii"][0, 0].tolist() == [ceil(cut_off * sqrt(v)) for v in (a, b)]
        assert alpha[0, 9, 12, 0].item() == pytest.approx(expected)
        assert color[0, 9, 12].tolist() == pytest.approx([expected * c for c in (0.8, 0.4, 0.2, z)])


def test_what_is_not_drawn_has_radius_zero():
    rows = [gaussian((0.0, 0.0, z), (0.05,) * 3) for z in (-1.0, 0.005, 2.0, 50.0, 2000.0)]
    aside, faint = gaussian((9.0, 0.0, 2.0)), gaussian((0.0, 0.0, 2.0), opacity=0.003)
    joined = by_name(rows[0], camera())
    for name in ("means", "quats", "scales", "opacities", "colors"):
        parts = (by_name(r, camera())[name] for r in (*rows, aside, faint))
        joined[name] = torch.cat(list(parts))
    drawn = [False, False, True, True, False, False, False]
    _, _, meta = rasterization(**joined, far_plane=100.0)
    assert (meta["radii"][0] > 0).all(-1).tolist() == drawn
    for name in ("means2d", "depths", "conics", "opacities"):
        assert not meta[name][0, ~torch.tensor(drawn)].any()
    clip = float(meta["radii"][0, 3].max())
    _, _, clipped = rasterization(**joined, far_plane=100.0, radius_clip=clip)
    assert (clipped["radii"][0] > 0).all(-1).tolist() == [False, False, True, *[False] * 4]


@pytest.mark.parametrize("mode", ["RGB", "D", "ED", "RGB+D", "RGB+ED"])
def test_render_modes(mode):
    scene, view = cloud(), camera()
    wanted = render_reference(scene, view, background=BACKGROUND)
    color, alpha, _ = rasterization(
        **by_name(scene, view), render_mode=mode, backgrounds=BACKGROUND[None]
    )
    parts = []
    if "RGB" in mode:
        parts.append(wanted.color)
    if mode.endswith("ED"):
        parts.append(wanted.depth[..., None])
    elif mode != "RGB":
        parts.append((wanted.depth * wanted.alpha)[..., None])
    assert (color[0] - torch.cat(parts, -1)).abs().max() < 1e-9
    assert (alpha[0, ..., 0] - wanted.alpha).abs().max() < 1e-9


@pytest.mark.parametrize(("mode", "channels"), [("D", 1), ("ED", 1), ("RGB", 3), ("RGB+ED", 4)])
def test_only_what_was_asked_for_is_blended(mode, channels, monkeypatch):
    module = sys.modules["rasterizer.rasterization"]
    blended = []

    def spy(splats, *rest, **options):
        blended.append(splats.features.shape[1])
        return original(splats, *rest, **options)

    original = module.splat
    monkeypatch.setattr(module, "splat", spy)
    rasterization(**by_name(cloud(), camera()), render_mode=mode)
    assert blended == [channels]


def test_cameras_and_batches_are_pictures_of_their_own():
    views = camera(), replace(camera(), fx=60.0, cx=25.0)
    scenes = cloud(), random_cloud(60, seed=4, degree=2)
    generator = torch.Generator().manual_seed(0)
    backgrounds = torch.rand(2, 2, 3, generator=generator, dtype=torch.float64)
    one = [by_name(scene, *views) for scene in scenes]
    stacked = {
        name: torch.stack([a[name] for a in one]) if torch.is_tensor(value) else value
        for name, value in one[0].items()
    }
    stacked["means"].requires_grad_()
    options = {"render_mode": "RGB+ED"}
    color, alpha, meta = rasterization(**stacked, **options, backgrounds=backgrounds)
    assert color.shape == (2, 2, 32, 40, 4)
    assert alpha.shape == (2, 2, 32, 40, 1)
    assert (meta["n_batches"], meta["n_cameras"]) == (2, 2)
    color.sum().backward()
    for b, scene in enumerate(scenes):
        for c, view in enumerate(views):
            means = scene.means.clone().requires_grad_()
            alone, _, own = rasterization(
                **by_name(scene, view) | {"means": means},
                **options,
                backgrounds=backgrounds[b, c][None],
            )
            alone.sum().backward()
            assert torch.equal(alone[0], color[b, c])
            for name in ("means2d", "radii", "depths", "conics", "opacities"):
                assert torch.equal(own[name][0], meta[name][b, c]), name
            assert torch.equal(own["means2d"].grad[0], meta["means2d"].grad[b, c])


@pytest.mark.parametrize("harmonic", [False, True])
def test_colors_may_differ_by_camera(harmonic):
    views = camera(), replace(camera(), cx=25.0)
    scene = cloud()
    painted = torch.stack((scene.sh, scene.sh.flip(0)))
    degree = 2
    if not harmonic:
        painted, degree = painted[:, :, 0], None
    arguments = by_name(scene, *views) | {"sh_degree": degree}
    color, _, _ = rasterization(**arguments | {"colors": painted})
    for i, view in enumerate(views):
        own = by_name(scene, view) | {"sh_degree": degree, "colors": painted[i]}
        assert torch.equal(color[i], rasterization(**own)[0][0])


def test_gradients_of_features_backgrounds_and_opacities():
    """The picture is linear in the first two; of the third, finite differences."""
    scene, view = cloud(0), camera()
    arguments = by_name(scene, view) | {"sh_degree": None}
    features = (0.5 + SH_DC * scene.sh[:, 0]).requires_grad_()
    background = BACKGROUND[None].clone().requires_grad_()
    opacities = scene.opacities.requires_grad_()

    def loss(features, background, opacities):
        changed = {"colors": features, "backgrounds": background, "opacities": opacities}
        return loss_of(*rasterization(**arguments | changed)[:2])

    inputs = (features, background, opacities)
    gradients = torch.autograd.grad(loss(*inputs), inputs)
    generator = torch.Generator().manual_seed(1)
    for i, (value, gradient) in enumerate(zip(inputs, gradients)):
        step = torch.randn(value.shape, generator=generator, dtype=torch.float64) * 1e-7
        up, down = (loss(*inputs[:i], value + s * step, *inputs[i + 1 :]) for s in (1, -1))
        assert (up - down).item() / 2 == pytest.approx((gradient * step).sum().item(), rel=1e-5)


@pytest.mark.parametrize("dtype", DTYPES)
def test_opacities_of_exactly_0_and_1(dtype):
    scene, view = cloud().to(dtype), camera()
    opacities = scene.opacities.clone()
    opacities[:20], opacities[20:40] = 0.0, 1.0
    opacities.requires_grad_()
    color, alpha, _ = rasterization(**by_name(scene, view) | {"opacities": opacities})
    exact = replace(scene, logit_opacities=torch.logit(opacities.detach()))
    wanted = render_reference(exact, view).color
    # with 20 opaque ones a tile may be finished: the stop's 1e-5, and float32
    assert ((color[0] - wanted).abs() > 3e-5).double().mean() < 2e-3
    loss_of(color, alpha).backward()
    assert opacities.grad is not None
    assert opacities.grad.isfinite().all()
    assert not opacities.grad[:20].any()
    assert opacities.grad[20:40].any()


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("rows", ["none", "behind"])
def test_nothing_to_see_is_the_background(rows, dtype):
    scene = cloud().to(dtype)
    scene = scene[:0] if rows == "none" else replace(scene, means=-scene.means)
    arguments = by_name(leaves(scene), camera())
    for name in ("means", "viewmats"):
        arguments[name] = arguments[name].detach().clone().requires_grad_()
    color, alpha, meta = rasterization(
        **arguments, backgrounds=BACKGROUND.to(dtype)[None], render_mode="RGB+ED"
    )
    assert (color[0, ..., :3] == BACKGROUND.to(dtype)).all()
    assert not color[..., 3].any()
    assert not alpha.any()
    assert meta["means2d"].shape == (1, len(scene), 2)
    (color.sum() + alpha.sum()).backward()
    for tensor in (arguments["means"], arguments["viewmats"], meta["means2d"]):
        assert not tensor.grad.any()


def test_what_only_costs_time_on_a_gpu_changes_nothing():
    arguments = by_name(cloud(), camera())
    plain, _, _ = rasterization(**arguments)
    for option in ({"packed": False}, {"channel_chunk": 1}, {"segmented": True}):
        assert torch.equal(rasterization(**arguments, **option)[0], plain)
    for option in ({"tile_size": 4}, {"execution": Execution(tile_size=32)}):
        color, _, meta = rasterization(**arguments, **option)
        assert (color - plain).abs().max() < 1e-11
        size = meta["tile_size"]
        assert size in (4, 32)
        assert (meta["tile_width"], meta["tile_height"]) == (ceil(40 / size), ceil(32 / size))
    both = {"tile_size": 8, "execution": Execution(tile_size=32)}
    assert rasterization(**arguments, **both)[2]["tile_size"] == 8


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("sparse_grad", True),
        ("absgrad", True),
        ("distributed", True),
        ("camera_model", "fisheye"),
        ("camera_model", "ftheta"),
        ("with_ut", True),
        ("with_eval3d", True),
        ("radial_coeffs", torch.zeros(1, 6)),
        ("tangential_coeffs", torch.zeros(1, 2)),
        ("thin_prism_coeffs", torch.zeros(1, 4)),
        ("ftheta_coeffs", object()),
        ("rolling_shutter", "ROLLING_TOP_TO_BOTTOM"),
        ("viewmats_rs", torch.eye(4)[None]),
    ],
)
def test_what_is_not_here_says_so(option, value):
    with pytest.raises(NotImplementedError, match=option):
        rasterization(**by_name(cloud(), camera()), **{option: value})


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("quats", torch.zeros(60, 3)),
        ("scales", torch.zeros(59, 3)),
        ("scales", None),
        ("opacities", torch.zeros(60, 1)),
        ("colors", torch.zeros(60, 3)),
        ("colors", torch.zeros(60, 4, 3)),
        ("colors", torch.zeros(3, 60, 9, 3)),
        ("viewmats", torch.zeros(2, 4, 4)),
        ("viewmats", torch.zeros(0, 4, 4)),
        ("Ks", torch.zeros(1, 4, 4)),
        ("backgrounds", torch.zeros(1, 4)),
        ("covars", torch.zeros(60, 3)),
        ("render_mode", "RGBD"),
        ("rasterize_mode", "smooth"),
    ],
)
def test_shapes_that_do_not_fit_are_named(name, value):
    unchecked = unwrap(rasterization)  # without jaxtyping, as users have it
    named = "Ks" if name == "viewmats" and len(value) == 2 else name  # two poses, one intrinsic
    with pytest.raises(ValueError, match=named):
        unchecked(**by_name(cloud(), camera()) | {name: value})


@pytest.mark.parametrize("bad", [float("nan"), float("inf")])
@pytest.mark.parametrize("name", ["means", "quats", "scales", "opacities", "colors", "viewmats",
                                  "Ks", "backgrounds", "covars"])  # fmt: skip
def test_what_is_not_finite_is_named(name, bad):
    arguments = by_name(cloud(), camera()) | {"backgrounds": BACKGROUND[None]}
    if name == "covars":
        arguments["covars"] = torch.eye(3).double().expand(60, 3, 3)
    spoilt = arguments[name].clone()
    spoilt.view(-1)[-1] = bad  # of the last row, which is in sight
    with pytest.raises(ValueError, match=name):
        rasterization(**arguments | {name: spoilt})


def test_a_near_plane_behind_a_pinhole_is_refused():
    with pytest.raises(ValueError, match=r"near is -1\.0"):
        rasterization(**by_name(cloud(), camera()), near_plane=-1.0)
    with pytest.raises(ValueError, match=r"near is -1\.0"):
        render(cloud(), camera(), numerics=Numerics(near=-1.0))


def test_without_blur_a_line_is_drawn_or_not_but_finite():
    """eps2d of 0 leaves a disc seen edge-on without a width on the picture."""
    scene = leaves(gaussian((0.0, 0.0, 2.0), (0.3, 0.3, 1e-30), (1.0, 1.0, 0.0, 0.0)))
    for mode in ("classic", "antialiased"):
        color, _, meta = rasterization(**by_name(scene, camera()), eps2d=0.0, rasterize_mode=mode)
        color.sum().backward()
        assert color.isfinite().all()
        assert meta["means2d"].grad.isfinite().all()
        assert all(t.grad is None or t.grad.isfinite().all() for t in tensors(scene))


def test_bands_that_are_zero_are_left_out():
    scene = cloud(4)
    sh = scene.sh.clone()
    sh[:, 4:] = 0
    assert without_zero_bands(sh).shape == (60, 4, 3)
    assert without_zero_bands(torch.zeros_like(sh)).shape == (60, 1, 3)
    assert without_zero_bands(scene.sh) is scene.sh
    late = torch.zeros(100, 25, 3)
    late[99, 24, 2] = 1e-30  # the last number of all
    assert without_zero_bands(late).shape == (100, 25, 3)
    # a zero has a gradient of its own: with one asked for, all bands stay
    assert without_zero_bands(sh.requires_grad_()).shape == (60, 25, 3)
    color, _, _ = rasterization(**by_name(replace(scene, sh=sh), camera()))
    color.sum().backward()
    assert sh.grad is not None
    assert sh.grad[:, 4:].any()
    with torch.no_grad():
        again, _, _ = rasterization(**by_name(replace(scene, sh=sh), camera()))
    assert (again - color).abs().max() < 1e-14


def test_an_orthographic_camera_projects_and_unprojects():
    view = ortho()
    points = cloud().means
    xy, depth = view.project(points)
    wanted = points[:, :2] * xy.new_tensor([8.0, 8.4]) + xy.new_tensor([20.8, 15.04])
    assert torch.allclose(xy, wanted)
    assert torch.equal(depth, points[:, 2])
    assert torch.allclose(view.unproject(xy, depth), points)
    assert view.resized(80, 64).model == "ortho"
