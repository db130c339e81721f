"""Regions: how they are written, drawn, found from masks and predictions, and kept in files."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from labelled import statue
from PIL import Image
from regions_iou import iou

from gsedit import View
from gsedit.errors import InputError, UsageError
from gsedit.formats.flags import read_flags
from gsedit.paper.edit_views import find_changed
from gsedit.select.finder import Finder
from gsedit.select.masked import read_masks
from gsedit.select.region import (
    Region,
    coverage,
    everything,
    find_drawn,
    in_one_color,
    lift,
    save_region,
    tinted,
    within_silhouette,
)
from gsedit.select.surfaces import neighbors, smooth
from gsedit.select.where import check_region, expression_of, expression_of_clicks
from gsedit.views.orbit import circle
from rasterizer import render

SIZE = 48


@pytest.fixture(scope="module")
def labelled():
    return statue(0, 1500)


@pytest.fixture(scope="module")
def cameras(labelled):
    middle = torch.zeros(3, dtype=torch.float64)
    return circle(middle, 0.7, labelled.scene.up, 6, SIZE, elevation=20.0, fov=45.0)


@pytest.fixture(scope="module")
def pictures(labelled, cameras):
    """The exact probability that a pixel shows the subject."""
    truth = in_one_color(labelled.gaussians, labelled.subject)
    with torch.no_grad():
        return [render(truth, camera).color[..., 0] for camera in cameras]


def weights(labelled, cameras):
    return lift(labelled.gaussians, cameras, [torch.ones(SIZE, SIZE) for _ in cameras]).weight


# ---- as text ------------------------------------------------------------------------------------


def test_regions_as_text(tmp_path):
    told = {
        "all": "all()",
        "auto": "subject()",
        "box:1,-2,3,0,2,-3": "box(0.0, -2.0, -3.0, 1.0, 2.0, 3.0)",
        "sphere:1e-1,0,-2,.5": "sphere(0.1, 0.0, -2.0, 0.5)",
        "flags.npy": "flags('flags.npy')",
        "it's.png": """mask("it's.png")""",
        str(tmp_path): f"mask('{tmp_path}')",
        "thing('the red one') and not y > 1": "thing('the red one') and not y > 1",
    }
    for text, expression in told.items():
        assert expression_of(text) == expression
        check_region(text)
    clicks = expression_of_clicks(["a.jpg:1,2.5", "not:b:c:3,4"])
    assert clicks == "click('a.jpg', 1, 2.5, 'not:b:c', 3, 4)"
    check_region(clicks)


@pytest.mark.parametrize(
    "text",
    ["", "bear", "box:", "box:1,2,3", "box:1,2,3,4,5,nan", "sphere:0,0,0,0", "sphere:0,0,0,a",
     "scene.ply", "Auto"],
)  # fmt: skip
def test_other_texts_are_refused_with_the_forms(text):
    with pytest.raises(UsageError, match=r"region .*(give|must)"):
        check_region(text)


def test_a_finder_answers_short_forms_and_expressions_alike(labelled):
    scene = labelled.gaussians
    finder = Finder(scene)
    ball = finder.select("sphere:0,0,0,1")
    assert ball.how == "sphere(0.0, 0.0, 0.0, 1.0)"
    assert torch.equal(ball.inside, scene.means.norm(dim=1) <= 1)
    rest = finder.select(f"not {ball.how} or y > 5")
    assert torch.equal(rest.inside, ~ball.inside | (scene.means[:, 1] > 5))
    with pytest.raises(UsageError, match="holds no Gaussian"):
        finder.select("sphere:900,0,0,1")


@pytest.mark.parametrize("text", ["click('a', 1)", "click('a', 1, 2, 'b')", "subject(3)", "mask()"])
def test_a_question_without_its_answer_is_refused(text):
    with pytest.raises(UsageError, match=r"give|write|needed"):
        Finder(statue(0, 10).gaussians).select(text) if "a" in text else check_region(text)


# ---- as pictures --------------------------------------------------------------------------------


def test_coverage_and_what_is_left_make_the_picture(labelled, cameras):
    """A pixel is a sum over the Gaussians: those inside, and those outside."""
    scene, inside = labelled.gaussians, labelled.subject
    a = coverage(Region(inside), scene, cameras[0])
    b = coverage(Region(~inside), scene, cameras[0])
    with torch.no_grad():
        alpha = render(scene, cameras[0]).alpha
    torch.testing.assert_close(a + b, alpha, atol=1e-5, rtol=0)
    assert coverage(everything(scene), scene, cameras[0]).min() == 1


def test_only_the_inside_is_tinted(labelled, cameras):
    scene, region = labelled.gaussians, Region(labelled.subject)
    with torch.no_grad():
        before, after = (render(s, cameras[0]).color for s in (scene, tinted(scene, region.inside)))
    changed = (before - after).abs().amax(-1)
    covered = coverage(region, scene, cameras[0])
    assert changed[covered > 0.9].min() > 0.1
    assert changed[covered < 1e-6].max() < 1e-5


# ---- as files -----------------------------------------------------------------------------------


def test_a_region_comes_back_from_its_file(labelled, tmp_path):
    path = tmp_path / "region.npy"
    save_region(Region(labelled.subject), path)
    assert (read_flags(path, len(labelled.subject)) == labelled.subject.numpy()).all()
    with pytest.raises(UsageError, match="exists"):
        save_region(Region(labelled.subject), path)
    with pytest.raises(InputError, match=r"region\.npy has flags of shape .* 7 Gaussians"):
        read_flags(path, 7)


def test_files_that_hold_no_flags_are_refused(tmp_path):
    (tmp_path / "text.npy").write_text("no")
    np.save(tmp_path / "words.npy", np.array(["a", "b"]))
    for name in ("text.npy", "words.npy", "absent.npy"):
        with pytest.raises(InputError, match=name):
            read_flags(tmp_path / name, 2)
    np.save(tmp_path / "numbers.npy", np.array([0, 2]))
    assert read_flags(tmp_path / "numbers.npy", 2).tolist() == [False, True]


def test_masks_belong_to_the_views_that_they_are_named_after(cameras, tmp_path):
    views = [
        View(f"photos/a_{i}.jpg", c, torch.zeros(SIZE, SIZE, 3)) for i, c in enumerate(cameras)
    ]
    mask = np.zeros((2 * SIZE, 2 * SIZE), np.uint8)
    mask[:SIZE] = 255
    Image.fromarray(mask).save(tmp_path / "a_3.png")
    Image.fromarray(mask).save(tmp_path.with_name("003_a_3.png"))  # as gsedit render names it
    for path in (tmp_path, tmp_path / "a_3.png", tmp_path.with_name("003_a_3.png")):
        masks = read_masks(path, views)
        assert list(masks) == [3]
        assert masks[3][: SIZE // 2].min() == 1
        assert masks[3][SIZE // 2 :].max() == 0
    transparent = np.full((SIZE, SIZE, 4), 255, np.uint8)
    transparent[:, :9, 3] = 0
    Image.fromarray(transparent).save(tmp_path / "a_4.png")
    assert read_masks(tmp_path / "a_4.png", views)[4].sum(0).bool().sum() == SIZE - 9


@pytest.mark.parametrize(
    ("name", "rows", "message"),
    [
        ("b", SIZE, r"b\.png belongs to no view: name it after .*a_0"),
        ("a_2", SIZE // 2, "draw it on the same picture"),
        ("a_0", SIZE, "2 views are named a_0"),
    ],
)
def test_masks_that_fit_no_view_are_refused(cameras, tmp_path, name, rows, message):
    views = [View(f"a_{i}.jpg", c, torch.zeros(SIZE, SIZE, 3)) for i, c in enumerate(cameras)]
    Image.fromarray(np.zeros((rows, SIZE), np.uint8)).save(tmp_path / f"{name}.png")
    with pytest.raises(InputError, match=message):
        read_masks(tmp_path, [*views, replace(views[0], name="other/a_0.jpg")])


# ---- from pictures ------------------------------------------------------------------------------


def test_a_constant_is_lifted_to_itself(labelled, cameras):
    """The mean over blending weights of a constant is that constant; the weights are pixels."""
    maps = [torch.full((SIZE, SIZE), 0.3) for _ in cameras]
    lifted = lift(labelled.gaussians, cameras, maps)
    seen = lifted.weight > 1e-3
    torch.testing.assert_close(lifted.mean[seen], torch.full_like(lifted.mean[seen], 0.3))
    with torch.no_grad():
        pixels = sum(render(labelled.gaussians, camera).alpha.sum() for camera in cameras)
    torch.testing.assert_close(lifted.weight.sum(), pixels, rtol=1e-4, atol=0)


def test_smoothing_keeps_what_is_sure_and_fills_what_is_not(labelled):
    graph = neighbors(labelled.gaussians)
    values = labelled.subject.float()
    constant = smooth(torch.full_like(values, 0.4), torch.ones_like(values), graph, 10.0)
    torch.testing.assert_close(constant, torch.full_like(values, 0.4), atol=1e-3, rtol=0)
    unknown = torch.rand(len(values), generator=torch.Generator().manual_seed(0)) < 0.3
    filled = smooth(values * ~unknown, (~unknown).float(), graph, 0.1)
    right = (filled > 0.5) == labelled.subject
    assert right[unknown].float().mean() > 0.95


def test_masks_of_two_views_select_what_no_mask_sees_too(labelled, cameras, pictures):
    lifted = lift(labelled.gaussians, cameras[:4:3], pictures[:4:3])
    found = find_drawn(labelled.gaussians, lifted)
    assert iou(found, labelled.subject, weights(labelled, cameras)) > 0.85


def test_what_an_edit_changes_is_found_unless_it_is_everything(labelled, cameras, pictures):
    changes = [0.02 + 0.2 * picture for picture in pictures]
    found = find_changed(labelled.gaussians, lift(labelled.gaussians, cameras, changes))
    assert found is not None
    assert iou(found, labelled.subject, weights(labelled, cameras)) > 0.9
    for background in (0.1, 0.2):
        changes = [background + 0.1 * picture for picture in pictures]
        lifted = lift(labelled.gaussians, cameras, changes)
        assert find_changed(labelled.gaussians, lifted) is None
    nothing = [torch.zeros(SIZE, SIZE) for _ in cameras]
    assert find_changed(labelled.gaussians, lift(labelled.gaussians, cameras, nothing)) is None


def test_a_wide_gaussian_that_shows_beyond_the_silhouette_is_left_out(labelled, cameras):
    scene, inside = labelled.gaussians, labelled.subject
    narrow = within_silhouette(scene, cameras, inside)
    assert not (narrow & ~inside).any()
    assert iou(narrow, inside, lift(scene, cameras, [torch.ones(SIZE, SIZE)] * 6).weight) > 0.95
    one = int(narrow.nonzero()[0])
    log_scales, logits = scene.log_scales.clone(), scene.logit_opacities.clone()
    log_scales[one], logits[one] = float(np.log(0.5)), -1.0  # thin: no silhouette of its own
    wide = replace(scene, log_scales=log_scales, logit_opacities=logits)
    kept = within_silhouette(wide, cameras, inside)
    assert not kept[one]
    assert float(kept.float().mean()) > 0.9 * float(inside.float().mean())
    assert torch.equal(within_silhouette(wide, [], inside), inside)
