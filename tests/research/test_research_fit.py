"""Both recipes fit a capture under one budget, measured at moments that cost nothing."""

from __future__ import annotations

import itertools
import json
from collections import Counter
from dataclasses import replace

import pytest
import torch
from research.fit import captures, gsplat_recipe, run
from research.fit.clock import Clock
from research.fit.gsplat_recipe import GsplatSettings, gsplat_fit

from gsedit import FitSettings, load_dataset
from gsedit.errors import UsageError
from gsedit.synthetic.gallery import globe
from rasterizer.numerics import AUTO

SIZE, VIEWS, POINTS = 32, 9, 200


@pytest.fixture(scope="module")
def photos():
    return captures.photographed(captures.room(globe()), VIEWS, SIZE, points=POINTS)


def ticking(step=1.0):
    """A clock that moves by a step whenever it is read."""
    return map(float, itertools.count(0, step)).__next__


def test_a_clock_stands_while_it_is_paused():
    now = 3.0
    clock = Clock(lambda: now)
    now = 5.0
    with clock.paused():
        now = 105.0
    now = 106.0
    assert clock() == 3.0


def test_a_written_capture_is_read_as_it_was(photos, tmp_path):
    captures.write_dataset(photos, tmp_path)
    read = load_dataset(tmp_path)
    assert [view.name for view in read.views] == [f"{view.name}.png" for view in photos.views]
    for one, other in zip(read.views, photos.views):
        assert torch.equal(one.image, other.image)
        torch.testing.assert_close(
            one.camera.world_to_camera.double(), other.camera.world_to_camera.double()
        )
        assert one.camera.fx == pytest.approx(other.camera.fx)
    torch.testing.assert_close(read.points, photos.points)
    torch.testing.assert_close(read.point_colors, photos.point_colors, atol=0.51 / 255, rtol=0)


def test_photos_that_are_held_out_have_no_exposure():
    room = captures.room(globe())
    plain, exposed = (
        captures.photographed(room, VIEWS, 16, points=POINTS, exposures=each) for each in (0.0, 0.3)
    )
    apart = [
        float((one.image - other.image).mean().abs())
        for one, other in zip(plain.views, exposed.views)
    ]
    assert max(apart[0], apart[8]) < 0.002  # the noise is drawn anew
    assert sum(apart) > 0.2


def test_the_recipe_of_gsplat_grows_prunes_and_lowers(photos):
    """30 of its steps, with what happens in thousands of them."""
    settings = GsplatSettings(
        steps=30, sh_every=8, refine_start=4, refine_stop=28, refine_every=5, reset_every=12,
        grow_gradient=1e-5,
    )  # fmt: skip
    moments = list(
        gsplat_fit(
            photos, 90.0, moments=3, clock=ticking(), generator=torch.Generator().manual_seed(0),
            settings=settings,
        )
    )  # fmt: skip
    assert [moment.seconds for moment in moments] == sorted(moment.seconds for moment in moments)
    first, last = moments[0].scene, moments[-1].scene
    assert len(last) > len(photos.points)
    assert last.sh.shape[1] == 16
    assert last.opacities.max() < 0.6  # it was 0.1, and was lowered to 0.01 at steps 12 and 24
    assert first.means.isfinite().all()


def test_small_gaussians_are_copied_and_large_ones_divided(photos):
    scene = gsplat_recipe._initial(photos, GsplatSettings())[torch.arange(4)]
    scene = replace(scene, log_scales=torch.tensor([0.1, 0.1, 1, 1]).log()[:, None].repeat(1, 3))
    high = torch.tensor([True, False, True, False])
    grown, origin, fresh = gsplat_recipe._grown(scene, high, 0.5, torch.Generator())
    assert Counter(origin.tolist()) == {0: 2, 1: 1, 2: 2, 3: 1}
    assert fresh.tolist() == [False] * 3 + [True] * 3
    halves = grown.scales[origin == 2]
    torch.testing.assert_close(halves, torch.full_like(halves, 1 / 1.6))
    torch.testing.assert_close(grown.means[3], scene.means[0])


def test_a_bench_measures_all_recipes_and_writes_a_folder(photos, tmp_path):
    captures.write_dataset(photos, tmp_path / "room")
    settings = run.BenchSettings(
        (tmp_path / "room",), synthetic=0, seconds=60.0, moments=2, size=SIZE,
        fit=FitSettings(coarse=()),
    )  # fmt: skip
    rows = [
        row
        for row in run.to_folder(settings, tmp_path / "out", read=ticking())
        if isinstance(row, run.FitMeasurement)
    ]
    counts = Counter(row.recipe for row in rows)
    assert set(counts) == {run.OURS, run.GSPLAT}
    assert all(count >= 2 for count in counts.values())
    assert all(row.psnr > 5 and row.gaussians > POINTS for row in rows)
    assert {path.name for path in (tmp_path / "out").iterdir()} == set(run.FILES)
    assert "gsplat, its own steps" in (tmp_path / "out" / run.TABLE).read_text()


def test_masked_pixels_are_not_measured(photos):
    scene = gsplat_recipe._initial(photos, GsplatSettings())
    (view,) = photos.views[:1]
    mask = torch.zeros(SIZE, SIZE, dtype=torch.bool)
    mask[: SIZE // 2] = True
    found = []
    for seed in (0, 1):
        noise = torch.rand(SIZE, SIZE, 3, generator=torch.Generator().manual_seed(seed))
        image = torch.where(mask[..., None], view.image, noise)
        hidden = replace(view, mask=mask & ~mask)
        found.append(run.measure(scene, [replace(view, image=image, mask=mask), hidden], AUTO))
    assert found[0] == found[1] != run.measure(scene, [view], AUTO)


def test_a_capture_without_points_is_refused_before_anything_is_fitted(photos, tmp_path):
    captures.write_dataset(photos, tmp_path / "room")
    record = json.loads((tmp_path / "room/transforms.json").read_text())
    del record["ply_file_path"]
    (tmp_path / "room/transforms.json").write_text(json.dumps(record))
    settings = run.BenchSettings((tmp_path / "room",), synthetic=0)
    with pytest.raises(UsageError, match=r"room has no sparse points, .* leave it out"):
        next(run.load_captures(settings, tmp_path))
