"""Pictures are made when they are read, kept in 8 bits while there is room, and the same always."""

from dataclasses import replace

import torch

from gsedit import Dataset, View
from gsedit.bench.synthetic import demo_scene, ring_cameras
from gsedit.views.lazy_views import PixelCache, of_one_size

CAMERA = ring_cameras(demo_scene(), 1, 8)[0]
IMAGE = torch.rand(8, 8, 3, generator=torch.Generator().manual_seed(0))
MASK = IMAGE[..., 0] > 0.5


def test_a_smaller_copy_is_made_when_it_is_read():
    view = View("a", CAMERA, IMAGE, MASK)
    small = PixelCache().resized(view, 4, 4)
    assert (small.camera.width, small.camera.height) == (4, 4)
    expected = view.resized(4, 4)
    torch.testing.assert_close(small.image, expected.image, atol=0.5 / 255 + 1e-7, rtol=0)
    assert torch.equal(small.mask, expected.mask)
    assert small.alpha is None
    assert PixelCache().resized(view, 8, 8) is view


def test_views_of_several_sizes_are_framed_in_the_most_frequent_one():
    """The whole picture in the middle, masked around it; each pixel looks where it looked."""
    camera = replace(CAMERA, cx=3.0, cy=5.5, height=12)
    tall = View("tall", camera, torch.rand(12, 8, 3), alpha=torch.ones(12, 8))
    wide = [View(name, CAMERA.resized(12, 6), torch.ones(6, 12, 3)) for name in "abc"]
    dataset = Dataset((wide[0], tall, *wide[1:]), notes=("one",))
    framed = of_one_size(dataset)
    view = framed.views[1]
    assert framed.views[0] is wide[0]
    assert framed.notes == ("one", "views of 2 sizes: 1 of 4 are framed in 12x6")
    assert view.image.shape == (6, 12, 3)
    inner = tall.resized(4, 6)
    assert view.mask is not None
    assert view.mask.sum() == 24
    torch.testing.assert_close(view.image[:, 4:8], inner.image, atol=0.5 / 255 + 1e-7, rtol=0)
    point = torch.tensor([[0.1, 0.2, 0.3]], dtype=torch.float64)
    (xy, _), (inside, _) = (each.camera.project(point) for each in (view, inner))
    torch.testing.assert_close(xy, inside + torch.tensor([4.0, 0.0]).double())
    assert of_one_size(Dataset(tuple(wide))).views[0] is wide[0]
