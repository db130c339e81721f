"""Both recipes fit a capture under one budget, measured at moments that cost nothing."""

import itertools
from collections import Counter

import pytest
import torch
from research.fit import captures, run
from research.fit.gsplat_recipe import GsplatSettings, gsplat_fit
from small_scenes import globe

from gsedit import FitSettings, load_dataset

SIZE, VIEWS, POINTS = 32, 9, 200


@pytest.fixture(scope="module")
def photos():
    return captures.photographed(captures.room(globe()), VIEWS, SIZE, points=POINTS)


def ticking(step=1.0):
    """A clock that moves by a step whenever it is read."""
    return map(float, itertools.count(0, step)).__next__


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
