"""Crops of the edited views reach their borders."""

import torch

from gsedit.bench.synthetic import demo_scene, ring_cameras
from gsedit.capture.fitting.update import random_crop


def test_the_borders_of_a_picture_are_in_a_third_as_many_crops_as_its_middle_or_more():
    generator = torch.Generator().manual_seed(0)
    wide = ring_cameras(demo_scene(), 1, 64)[0].resized(256, 128)
    counts = torch.zeros(128, 256)
    for _ in range(4000):
        left, top, width, height = random_crop(wide, 64, generator)
        assert width == height == 64
        assert 0 <= left <= 256 - 64
        assert 0 <= top <= 128 - 64
        counts[top : top + 64, left : left + 64] += 1
    columns, rows = counts.mean(0), counts.mean(1)
    assert min(columns[0], columns[-1]) >= columns[128] / 3
    assert min(rows[0], rows[-1]) >= rows[64] / 3
