"""The subject of a scene: the network, segments that stand out, and what carries them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from labelled import statue
from regions_iou import iou

from gsedit.bench.synthetic.paint import parts, plain
from gsedit.bench.synthetic.scene import SyntheticScene
from gsedit.bench.synthetic.shapes import capsule, cylinder, translate, union
from gsedit.bench.synthetic.splats import surface_gaussians
from gsedit.editing.parts import find_parts
from gsedit.editing.plan import read_steps
from gsedit.errors import InputError
from gsedit.select.finder import Finder
from gsedit.select.region import Region, coverage, lift
from gsedit.select.subject import SIDE, block_under, find_subject, load_network, salient
from gsedit.select.surfaces import look
from gsedit.views.orbit import circle
from gsedit.views.viewpoints import Viewpoint

SIZE = 64
ONNX = Path(__file__).parents[3] / "shared/data/weights/u2netp.onnx"


@pytest.fixture(scope="module")
def labelled():
    return statue(0, 3000)


@pytest.fixture(scope="module")
def cameras(labelled):
    middle = torch.zeros(3, dtype=torch.float64)
    return circle(middle, 0.7, labelled.scene.up, 6, SIZE, elevation=20.0, fov=45.0)


def shown(labelled, cameras):
    """Saliency that is the exact share of the subject, whatever the picture."""
    region = Region(labelled.subject)
    maps = iter([coverage(region, labelled.gaussians, c.fitted(SIDE)) for c in cameras])
    return lambda pictures: next(maps)[None]


def test_the_network_equals_the_published_file():
    openvino = pytest.importorskip("openvino")
    if not ONNX.exists():
        pytest.skip(f"{ONNX} is not there")
    x = torch.randn(1, 3, SIDE, SIDE, generator=torch.Generator().manual_seed(0))
    exact = {"INFERENCE_PRECISION_HINT": "f32"}
    expected = openvino.Core().compile_model(str(ONNX), "CPU", exact)(x.numpy())[0]
    with torch.no_grad():
        found = load_network()(x)
    assert np.abs(found.numpy() - expected[0]).max() < 1e-4


def test_pictures_of_any_size_keep_it_and_the_global_generator_is_left_alone():
    before = torch.get_rng_state()
    for size in ((2, 20, 31), (1, 1, 1)):
        found = salient(torch.zeros(*size, 3))
        assert found.shape == size
        assert found.isfinite().all()
    assert torch.equal(torch.get_rng_state(), before)


def test_a_disc_stands_out():
    grid = torch.stack(torch.meshgrid(*[torch.linspace(-1, 1, 96)] * 2, indexing="ij"), -1)
    disc = grid.norm(dim=-1) < 0.5
    picture = torch.where(disc[..., None], torch.tensor((0.9, 0.2, 0.1)), torch.tensor(0.4))
    found = salient(picture[None])[0] > 0.5
    assert (found & disc).sum() > 0.9 * (found | disc).sum()


@pytest.mark.parametrize("content", [None, b"", b"\x08" + bytes(40)])
def test_weights_that_are_missing_or_damaged(tmp_path, content):
    path = tmp_path / "u2net.safetensors"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=r"does not hold the weights .* --at"):
        load_network(path)


def test_what_stands_out_is_the_subject_without_its_block(labelled, cameras):
    scene = labelled.gaussians
    found = find_subject(scene, cameras, saliency=shown(labelled, cameras))
    assert found.note == "auto: the subject"
    weight = lift(scene, cameras, [torch.ones(SIZE, SIZE) for _ in cameras]).weight
    assert iou(found.inside, labelled.subject, weight) > 0.85


def test_where_nothing_stands_out_it_is_everything(labelled, cameras):
    found = find_subject(labelled.gaussians, cameras, saliency=lambda p: 0.2 * p.mean(-1) / 2)
    assert found.is_all
    assert "no subject stands out" in found.note


def test_the_subject_without_surroundings_is_the_whole_scan(labelled, cameras):
    scan = labelled.gaussians[labelled.subject]
    found = find_subject(scan, cameras, saliency=lambda p: (p.amax(-1) > 0.02).float())
    assert found.is_all
    assert "nothing around" in found.note


@pytest.fixture(scope="module")
def surfaces(labelled, cameras):
    return look(labelled.gaussians, cameras)


def standing(surfaces, parts):
    """Surfaces with points on the sides of upright cylinders: (radius, low, high, x) each."""
    random, points, part = np.random.default_rng(0), [], []
    for i, (radius, low, high, x) in enumerate(parts):
        count = int(3000 * radius * (high - low)) + 200
        turn, z = random.uniform(0, 2 * np.pi, count), random.uniform(low, high, count)
        points.append(np.stack((x + radius * np.cos(turn), radius * np.sin(turn), z), 1))
        part.append(np.full(count, i))
    points, part = np.concatenate(points), np.concatenate(part)
    area = [
        2 * np.pi * r * (high - low) / (part == i).sum()
        for i, (r, low, high, _) in enumerate(parts)
    ]
    up = torch.tensor((0.0, 0.0, 1.0), dtype=torch.float64)
    front = torch.tensor((0.0, 1.0, 0.0), dtype=torch.float64)
    made = replace(
        surfaces, points=points, seen=np.ones(len(points)), normals=np.zeros_like(points),
        colors=np.zeros_like(points), solid=np.ones(len(points), bool),
        place=replace(surfaces.place, up=up, front=front),
    )  # fmt: skip
    made.__dict__["areas"] = np.array(area)[part]
    return made, part


@pytest.mark.parametrize("top", [0.36, 0.38, 0.4, 0.42])
def test_a_block_that_a_thing_stands_on_is_cut_off_at_its_top(surfaces, top):
    rock = (0.5, 0.0, top, 0.0)
    legs, body = [(0.08, top, 0.8, x) for x in (-0.2, 0.2)], (0.6, 0.8, 2.0, 0.0)
    made, part = standing(surfaces, [rock, *legs, body])
    block = block_under(made, np.ones(len(part), bool))
    assert abs(made.heights[block].max() - top) < 0.04  # half a slice; it was off by 0.1


def test_a_table_stands_on_no_block(surfaces):
    feet = [(0.1, 0.0, 0.9, x) for x in (-1.0, 1.0)]
    made, part = standing(surfaces, [*feet, (1.2, 0.9, 1.0, 0.0)])
    assert not block_under(made, np.ones(len(part), bool)).any()
    column, _ = standing(surfaces, [(0.5, 0.0, 2.0, 0.0)])
    assert not block_under(column, np.ones(len(column), bool)).any()


def test_a_table_has_its_legs_and_takes_along_what_is_on_it_only_where_it_goes():
    feet = [(x, y) for x in (-0.4, 0.4) for y in (-0.4, 0.4)]
    legs = union(*(capsule((x, y, -0.5), (x, y, -0.02), 0.04) for x, y in feet))
    shapes = (
        translate(cylinder(1.5, 0.06), (0, 0, -0.56)), translate(cylinder(0.7, 0.03), (0, 0, 0.01)),
        legs, translate(cylinder(0.12, 0.15), (0, 0, 0.19)),
    )  # fmt: skip
    colors = ((0.42, 0.5, 0.3), (0.6, 0.45, 0.3), (0.15, 0.1, 0.08), (0.85, 0.85, 0.9))
    paint, up = parts(*zip(shapes, map(plain, colors))), torch.eye(3).double()[2]
    made = SyntheticScene("table", union(*shapes), paint, torch.full((3,), 0.8).double(), 1.7, up)
    scene = surface_gaussians(made, 8000, torch.Generator().manual_seed(0))
    of = torch.stack([shape(scene.means.double()) for shape in shapes]).argmin(0)
    ring = circle(-0.2 * up, 1.2, up, 6, 96, elevation=22.0, fov=45.0)
    finder = Finder(scene, [Viewpoint(str(i), each) for i, each in enumerate(ring)])
    for text, along in (("turn the table into bronze", 0), ("remove the table", 1)):
        inside = find_parts(read_steps(text), finder).flags["the table"].float()
        ground, top, leg, vase = (float(inside[of == i].mean()) for i in range(4))
        assert (ground, top > 0.95, leg > 0.3) == (0, True, True)
        assert abs(vase - along) < 0.02  # a Gaussian where it touches goes either way by rounding
