"""The pictures made for training: their ranges, units and masks, and that they vary."""

from __future__ import annotations

import pytest
import torch
from research.train_small.pictures import procedural
from research.train_small.random_scenes import random_scene, traced
from research.train_small.sources import FAR, Sources, cat, cat_packed, pack

SIZE = 32


def _seeded(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


@pytest.fixture(scope="module")
def ray_cast() -> Sources:
    return procedural(40, SIZE, _seeded())


@pytest.fixture(scope="module")
def sphere_traced() -> Sources:
    return traced(6, SIZE, _seeded())


@pytest.fixture(params=("ray_cast", "sphere_traced"))
def sources(request: pytest.FixtureRequest) -> Sources:
    return request.getfixturevalue(request.param)


def test_the_generator_alone_decides():
    for make in (procedural, traced):
        for first, second in zip(make(2, SIZE, _seeded(3)), make(2, SIZE, _seeded(3))):
            assert torch.equal(first, second)


def test_shapes_and_ranges(sources: Sources):
    n = len(sources.image)
    assert sources.image.shape == (n, SIZE, SIZE, 3)
    assert all(field.dtype == torch.float32 and field.isfinite().all() for field in sources)
    for share in (sources.image, sources.subject):
        assert 0 <= share.min() <= share.max() <= 1
    assert 0 < sources.depth.min() <= sources.depth.max() <= FAR


def test_normals_are_unit_or_absent(sources: Sources):
    length = sources.normal.norm(dim=-1)
    assert torch.minimum(length, (length - 1).abs()).max() < 1e-5  # float32, some roundings


def test_the_subject_is_a_thing_at_distance_one(sources: Sources):
    inside = sources.subject[..., 0] == 1
    assert (sources.depth[..., 0][inside] < FAR).all()
    assert (sources.normal[inside].norm(dim=-1) > 0.5).all()
    depth = sources.depth[..., 0][inside]
    assert 0.6 < depth.median() < 1.4


def test_floors_face_up(sources: Sources):
    """The commonest direction around the subjects is straight up."""
    around = sources.normal[sources.subject[..., 0] == 0]
    assert (around[..., 2] > 0.999).float().mean() > 0.1


def test_they_vary(ray_cast: Sources):
    share = ray_cast.subject.mean((1, 2, 3))
    assert share.quantile(0.1) < 0.15
    assert share.quantile(0.9) > 0.35
    assert ray_cast.image.mean((1, 2)).std(0).min() > 0.05


def test_packing_keeps_all_but_the_last_bits(sources: Sources):
    unpacked = pack(sources)[torch.arange(len(sources.image))]
    assert (unpacked.image - sources.image).abs().max() <= 0.51 / 255
    assert (unpacked.subject - sources.subject).abs().max() <= 0.51 / 255
    assert (unpacked.depth / sources.depth - 1).abs().max() <= 2**-11  # half precision
    assert (unpacked.normal - sources.normal).norm(dim=-1).max() <= 1 / 127


def test_packed_sources_are_small(sources: Sources):
    packed = pack(sources)
    fields = (packed.image, packed.depth, packed.normal, packed.subject)
    per_pixel = sum(field.nbytes for field in fields) / sources.depth.numel()
    assert per_pixel * 6000 * 128**2 < 1.2e9


def test_rows_and_cat(sources: Sources):
    index = torch.tensor([1, 0])
    both = cat((sources, sources.rows(index)))
    assert torch.equal(both.image[-1], sources.image[0])
    packed = cat_packed((pack(sources), pack(sources.rows(index))))
    assert len(packed) == len(both.image)
    assert torch.equal(packed[torch.tensor([len(packed) - 1])].depth, packed[index[1:]].depth)


def test_a_random_scene_is_within_its_ball():
    scene = random_scene(_seeded(5))
    directions = torch.nn.functional.normalize(
        torch.randn((500, 3), generator=_seeded(), dtype=torch.float64), dim=-1
    )
    outside = scene.sdf(1.02 * scene.radius * directions)
    assert (outside > 0).float().mean() > 0.9  # a square floor's corners may be cut off
    assert (scene.sdf(torch.zeros((1, 3), dtype=torch.float64)) < scene.radius).all()
