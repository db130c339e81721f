"""Batches for the training of the small editor: crops, augmentation, targets, cached pictures."""

from __future__ import annotations

import pytest
import torch
from research.train_small.batches import (
    NEAREST,
    color_jitter,
    flipped,
    random_crop,
    random_looks,
    training_batch,
)
from research.train_small.picture_cache import Chunk, cached_pictures
from research.train_small.pictures import procedural
from research.train_small.prompts import held_out_pair
from research.train_small.sources import FAR, PackedSources, pack
from research.train_small.target_edits import TARGET_EDITS


def seeded(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


@pytest.fixture(scope="module")
def pictures() -> PackedSources:
    return pack(procedural(12, 48, seeded()))


def test_batches_are_the_same_from_the_same_seed(pictures):
    one, two = (training_batch(pictures, 32, 3, 2, seeded(3)) for _ in range(2))
    assert torch.equal(one.images, two.images)
    assert torch.equal(one.targets, two.targets)
    assert one.prompts == two.prompts
    assert training_batch(pictures, 32, 3, 2, seeded(4)).prompts != one.prompts


def test_a_batch_is_pictures_prompts_and_target_images(pictures):
    batch = training_batch(pictures, 32, 8, 3, seeded())
    assert batch.images.shape == (8, 32, 32, 3)
    assert batch.targets.shape == (24, 32, 32, 3)
    assert len(batch.prompts) == 24
    for images in (batch.images, batch.targets):
        assert images.min() >= 0
        assert images.max() <= 1
    unedited = batch.images.repeat_interleave(3, 0)
    changed = (unedited - batch.targets).square().mean((1, 2, 3)).sqrt()
    assert changed.median() > 0.05
    assert all(batch.prompts)


def test_geometry_targets_are_bounded(pictures):
    geometry = training_batch(pictures, 32, 8, 1, seeded()).geometry
    subject, inverse_depth, height = geometry.unbind(-1)
    assert geometry.shape == (8, 32, 32, 3)
    assert ((subject > -1e-5) & (subject < 1 + 1e-5)).all()
    assert ((inverse_depth > 0) & (inverse_depth < 1 / NEAREST + 1e-5)).all()
    assert (height.abs() <= 1 + 1e-5).all()


def test_held_out_pairs_are_never_trained():
    looks = {random_looks(generator) for generator in [seeded()] for _ in range(3000)}
    pairs = {names for names in looks if len(names) == 2}
    assert len(pairs) > 300
    assert not any(held_out_pair(*pair) for pair in pairs)
    assert {names[0] for names in looks if len(names) == 1} == set(TARGET_EDITS)


def test_a_crop_keeps_its_geometry(pictures):
    for seed in range(5):
        crop = random_crop(pictures[torch.tensor([seed])], 24, seeded(seed))
        assert crop.image.shape == (1, 24, 24, 3)
        length = crop.normal.norm(dim=-1)
        assert ((length - 1).abs() < 1e-4).logical_or(length == 0).all()
        assert crop.depth.max() <= FAR
        assert crop.subject.min() >= 0


def test_flipping_twice_gives_the_picture(pictures):
    sources = pictures[torch.arange(3)]
    for once, twice in zip(sources, flipped(flipped(sources))):
        assert torch.equal(once, twice)


def test_color_jitter_keeps_the_picture_recognisable(pictures):
    images = pictures[torch.arange(12)].image
    jittered = color_jitter(images, seeded())
    assert (jittered - images).abs().mean() > 0.01
    both = torch.stack((images.mean(-1).flatten(), jittered.mean(-1).flatten()))
    assert torch.corrcoef(both)[0, 1] > 0.9


def test_halved_pictures_are_means_of_four_pixels(pictures):
    half = pictures.halved()
    assert half.image.shape == (12, 24, 24, 3)
    expected = pictures[torch.arange(12)].image.reshape(12, 24, 2, 24, 2, 3).mean((2, 4))
    assert (half[torch.arange(12)].image - expected).abs().max() < 1 / 255


def test_cached_pictures_are_made_once(tmp_path):
    chunks = (Chunk(7, 16, 3, 0), Chunk(8, 16, 2, 0))
    made = cached_pictures(tmp_path, chunks)
    assert len(made) == 5
    written = {path: path.stat().st_mtime_ns for path in tmp_path.iterdir()}
    assert torch.equal(cached_pictures(tmp_path, chunks).image, made.image)
    assert {path: path.stat().st_mtime_ns for path in tmp_path.iterdir()} == written


def test_augmented_prompts_have_the_same_targets(pictures):
    plain, varied = (training_batch(pictures, 16, 4, 2, seeded(), share) for share in (0.0, 1.0))
    assert torch.equal(plain.targets, varied.targets)
    assert plain.prompts != varied.prompts
