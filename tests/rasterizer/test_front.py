"""The compiled front end draws what the Python files draw, or leaves it to them."""

import warnings
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from importlib import import_module

import pytest
import torch
from closeness import leaves, tensors, weights_like
from scenes import EDGE_CASES, cloud

from gsedit.bench.renderer import stability
from gsedit.bench.renderer.stability import random_cloud
from rasterizer import Camera, Execution, Gaussians, Numerics, render
from rasterizer.blending import cpp_backend
from rasterizer.cpp_projection import kernel, picture

RENDER = import_module("rasterizer.render")  # the package's `render` is the function
COMPILED = Execution(kernel="compiled")
WHOLE_SUM = Numerics(transmittance_min=0.0)


@pytest.fixture(autouse=True)
def compiler():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        if kernel.load() is None or cpp_backend.load() is None:
            pytest.skip("no C++ compiler on this machine")


@pytest.fixture
def by_python(monkeypatch):
    """Renders by the Python files, with the compiled blending."""

    def render_it(*args, **kwargs):
        with monkeypatch.context() as patch:
            patch.setattr(RENDER, "draw", lambda *_, **__: None)
            return render(*args, **kwargs)

    return render_it


@pytest.fixture
def by_front(monkeypatch):
    """Renders by the front end; fails where that leaves it to the Python files."""
    drawn = []

    def spy(*args, **kwargs):
        drawn.append(picture.draw(*args, **kwargs))
        return drawn[-1]

    def render_it(*args, **kwargs):
        with monkeypatch.context() as patch:
            patch.setattr(RENDER, "draw", spy)
            result = render(*args, **kwargs)
        assert drawn[-1] is not None
        return result

    return render_it


def all_of(drawing, scene, camera, **options):
    """Everything that a picture has, and the gradients of a loss of all of it."""
    inputs = leaves(scene)
    options = {"numerics": WHOLE_SUM, "depth": True, "median_depth": True, **options}
    drawn = drawing(inputs, camera, execution=COMPILED, **options)
    parts = [p for p in (drawn.color, drawn.alpha, drawn.depth) if p is not None]
    products = [(part * weights_like(part, i)).sum() for i, part in enumerate(parts)]
    loss = torch.stack(products).sum()
    return [*parts, drawn.median_depth], torch.autograd.grad(loss, tensors(inputs))


def compare(found, wanted, picture_bar=1e-12, gradient_bar=1e-11):
    for a, b in zip(found[0], wanted[0]):
        assert (a is None) == (b is None)
        if a is not None:
            assert (a - b).abs().max() <= picture_bar * b.abs().max().clamp_min(1)
    largest = max((float(b.norm()) for b in wanted[1]), default=0.0)
    for a, b in zip(found[1], wanted[1]):
        assert a.isfinite().all()
        # what cancels is a rounding of the others; what passes 100,000 layers is 0, or denormal
        error = float((a - b).norm())
        assert error <= gradient_bar * max(float(b.norm()), 1e-3 * largest) or error < 1e-30


@pytest.mark.parametrize("name", EDGE_CASES)
def test_it_draws_what_the_python_files_draw(name, by_front, by_python):
    scene, camera = EDGE_CASES[name]()
    found, wanted = (all_of(each, scene, camera) for each in (by_front, by_python))
    compare(found, wanted, gradient_bar=1e-10 if "needle" in name else 1e-11)


@pytest.mark.parametrize("degree", range(5))
@pytest.mark.parametrize(
    "numerics",
    [
        Numerics(),
        Numerics(antialiased=True, transmittance_min=0.0),
        Numerics(radius_clip=3.0, near=2.5, far=5.5, blur=0.1, margin=-0.5),
    ],
    ids=["default", "antialiased", "clipped"],
)
def test_degrees_and_settings(degree, numerics, by_front, by_python):
    scene, camera = random_cloud(200, seed=degree, degree=degree), cloud()[1]
    options = {"numerics": numerics, "crop": (3, 5, 22, 17)}
    found, wanted = (all_of(each, scene, camera, **options) for each in (by_front, by_python))
    compare(found, wanted)


@pytest.mark.parametrize("near", [0.01, -3.0])
def test_parallel_rays(near, by_front, by_python):
    scene, camera = random_cloud(200, seed=3, degree=2), cloud()[1]
    pose = camera.world_to_camera.clone()
    pose[2, 3] -= 3.0  # some lie behind
    camera = replace(camera, model="ortho", fx=12.0, fy=13.0, world_to_camera=pose)
    options = {"numerics": Numerics(near=near)}
    found, wanted = (all_of(each, scene, camera, **options) for each in (by_front, by_python))
    compare(found, wanted)


DRAWN = [
    case
    for case in stability.EDGE_CASES
    if case.refused is None and case.name != "100,000 layers"  # takes seconds
]
REFUSED = [case for case in stability.EDGE_CASES if case.refused is not None]


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64], ids=str)
@pytest.mark.parametrize("case", DRAWN, ids=lambda case: case.name)
def test_extremes_stay_drawn(case, dtype, by_front, by_python):
    scene, camera, background = case.make(dtype)
    options = {"background": background, "median_depth": False}
    found, wanted = (all_of(each, scene, camera, **options) for each in (by_front, by_python))
    single = dtype == torch.float32
    double_bar = 1e-8 if case.name == "1e7 from the origin" else 1e-11
    compare(found, wanted, 4e-5 if single else double_bar, 4e-4 if single else 1e-9)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64], ids=str)
@pytest.mark.parametrize("case", REFUSED, ids=lambda case: case.name)
def test_errors_are_the_same(case, dtype, by_python):
    scene, camera, background = case.make(dtype)
    texts = []
    for each in (render, by_python):
        with pytest.raises(ValueError) as error:  # noqa: PT011 (the texts are compared)
            each(scene, camera, background=background, execution=COMPILED)
        texts.append(str(error.value))
    assert texts[0] == texts[1]


def test_the_number_of_threads_changes_no_bit():
    scene, camera = random_cloud(6000, seed=5, degree=1).to(torch.float32), cloud()[1]
    before = torch.get_num_threads()
    drawn = []
    try:
        for threads in (1, 3):
            torch.set_num_threads(threads)
            drawn.append(all_of(render, scene, camera, numerics=Numerics(), crop=(2, 3, 30, 20)))
    finally:
        torch.set_num_threads(before)
    for one, three in zip(drawn[0][0] + list(drawn[0][1]), drawn[1][0] + list(drawn[1][1])):
        assert torch.equal(one, three)


def test_poses_are_left_to_the_python_files():
    scene, camera = cloud()
    pose = camera.world_to_camera.clone().requires_grad_()
    color = render(scene, replace(camera, world_to_camera=pose), execution=COMPILED).color
    assert torch.autograd.grad(color.sum(), pose)[0].norm() > 0


def test_pictures_share_nothing_that_a_backward_pass_reads():
    """Three sizes are drawn, then go back in another order, one of them twice."""
    clouds = [(random_cloud(n, seed=n, degree=1), cloud()[1]) for n in (300, 40, 90)]
    alone = [all_of(render, *each)[1] for each in clouds]
    drawn = []
    for scene, camera in clouds:
        inputs = leaves(scene)
        seen = render(inputs, camera, execution=COMPILED, depth=True, numerics=WHOLE_SUM)
        parts = [seen.color, seen.alpha, seen.depth]
        products = [(part * weights_like(part, i)).sum() for i, part in enumerate(parts)]
        drawn.append((torch.stack(products).sum(), tensors(inputs)))
    for i in (1, 0, 2, 0):
        found = torch.autograd.grad(*drawn[i], retain_graph=True)
        assert all(torch.equal(a, b) for a, b in zip(found, alone[i]))


def test_threads_may_draw_at_the_same_time():
    clouds = [(random_cloud(100 + n, seed=n), cloud()[1]) for n in range(6)]
    wanted = [all_of(render, *each) for each in clouds]
    with ThreadPoolExecutor(3) as pool:
        for _ in range(3):
            found = list(pool.map(lambda each: all_of(render, *each), clouds))
            for a, b in zip(found, wanted):
                assert all(map(torch.equal, a[0] + list(a[1]), b[0] + list(b[1])))


def test_a_pose_may_move_on_before_the_backward_pass():
    scene, camera = random_cloud(50, seed=2), cloud()[1]
    wanted = all_of(render, scene, camera)[1]
    moving = replace(camera, world_to_camera=camera.world_to_camera.clone())

    def draw_and_move(*args, **kwargs):
        drawn = render(*args, **kwargs)
        moving.world_to_camera[0, 3] += 0.3
        return drawn

    found = all_of(draw_and_move, scene, moving)[1]
    assert all(map(torch.equal, found, wanted))


@pytest.mark.parametrize("field", kernel.FIELDS)
def test_shapes_that_do_not_fit_are_not_read(field):
    """The kernel gets addresses: a column that is missing is another array's memory."""
    scene, camera = cloud()
    object.__setattr__(scene, field, getattr(scene, field)[..., None])  # past the tests' checks
    box = (0, 0, camera.width, camera.height)
    assert picture.draw(scene, camera, box, Numerics(), COMPILED) is None


@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize("count", [1, 20_000, 140_000])
def test_a_tile_is_in_the_order_of_depths(count, threads):
    """Near and equal depths too, more than 16 of a kind: those keep the order of the file."""
    random = torch.Generator().manual_seed(0)
    depth = 2 + torch.randint(1000, (count,), generator=random).double() / 1000
    depth += torch.randint(40, (count,), generator=random) * 1e-12
    zeros = torch.zeros(count, dtype=torch.float64)
    scene = Gaussians(
        torch.stack((zeros, zeros, depth), -1),
        torch.ones(count, 4, dtype=torch.float64),
        torch.full((count, 3), -5.0, dtype=torch.float64),
        zeros,
        torch.zeros(count, 1, 3, dtype=torch.float64),
    )
    camera = Camera(torch.eye(4, dtype=torch.float64), 4.0, 4.0, 2.0, 2.0, 4, 4)
    request = kernel.Request(camera, (0, 0, 4, 4), Numerics(), COMPILED)
    before = torch.get_num_threads()
    try:
        torch.set_num_threads(threads)
        listed = kernel.list_gaussians(scene, request)
    finally:
        torch.set_num_threads(before)
    assert listed is not None
    assert torch.equal(listed.bins.members, depth.argsort(stable=True))
