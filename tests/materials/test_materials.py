"""Materials in the light of their scene: the table, the words, the patterns, and the laws."""

from dataclasses import replace
from typing import get_args

import numpy as np
import pytest
import torch
from bench.reflective import Finish, plain_base
from changes import painted
from plain_scenes import needles, same_bits

from gsedit.bench.synthetic import ring_cameras
from gsedit.change.materials.apply import displayed, in_material
from gsedit.change.materials.material import MATERIALS, Layer, Material, PatternName, material_of
from gsedit.change.materials.shading import Ground, environment_brdf, grain, share_of
from gsedit.errors import UsageError
from gsedit.scene.quaternions import even_directions
from gsedit.scene.similarity import moved_camera
from gsedit.toolkit.transform import scale, transform
from gsedit.words.read import read_instruction
from rasterizer.numerics import SH_DC
from rasterizer.render import render_picture

PATTERNS = get_args(PatternName)
BRONZE = Material("#b98550", metalness=1.0, roughness=0.38)


def subject_error(scene, lit, camera, finish):
    """Root mean squared error on the solid's pixels."""
    truth = lit.photograph(finish, camera, 24, 1).float()
    hit = lit.solid.trace(camera).hit
    return float((render_picture(scene, camera) - truth)[hit].square().mean().sqrt())


@pytest.mark.parametrize("name", ["glow", "glowing jade"])
def test_what_glows_is_brighter_than_without_its_glow(ball, name):
    """As much as it sends by itself, less what display colors clip."""
    _, scene, own, cameras = ball
    material = material_of(name)
    assert material is not None
    bare = replace(
        material, glow=0.0, layers=tuple(replace(each, glow=0.0) for each in material.layers)
    )
    made = [in_material(scene, own, each, cameras) for each in (material, bare)]
    lit, dull = (each.scene.sh[each.changed, 0] for each in made)
    assert (lit >= dull - 1e-4).float().mean() > 0.99  # highlights turn white
    assert (lit - dull).mean() * SH_DC > 0.1


def test_every_material_has_parameters_in_range():
    for name, material in MATERIALS.items():
        shares = [material.metalness, material.roughness, material.coat, material.translucency]
        shares += [material.transmission, material.specular]
        shares += [each for layer in material.layers for each in (layer.share, layer.roughness)]
        assert all(0 <= each <= 1 for each in shares), name
        colors = [material.color, *(layer.color for layer in material.layers)]
        assert all(len(color) == 7 and int(color[1:], 16) >= 0 for color in colors), name


@pytest.mark.parametrize("pattern", PATTERNS)
def test_a_pattern_is_on_its_share_of_a_ball(pattern):
    points = torch.from_numpy(even_directions(4000)).float()
    hollow = (points[:, 0] * 3).sin().clamp_min(0)
    share = share_of(Layer(pattern, "#000000", 0.3, 0.3), Ground(points, points, hollow))
    assert bool(((share >= 0) & (share <= 1)).all())
    assert 0.2 < float(share.mean()) < 0.45
    assert float(share.std()) > 0.1


def test_grains_are_no_lattice_on_a_flat_side():
    """Few waves would hold much of what a side shows: specks like fur, rust like a chessboard."""
    steps = torch.arange(128.0) / 12
    side = torch.cartesian_prod(steps, steps, torch.tensor((0.3,)))
    window = torch.hann_window(128)[:, None] * torch.hann_window(128)
    shares = []
    for seed in (0, 2, 5, 11, 31):
        power = torch.fft.fft2(grain(side, seed).reshape(128, 128) * window).abs().square()
        strongest = power.flatten().sort(descending=True).values[:12]
        shares.append(float(strongest.sum() / power.sum()))
    assert np.mean(shares) < 0.32


def test_a_metal_keeps_its_color_but_for_the_last_degrees_of_grazing():
    gold = torch.tensor([[1.0, 0.7, 0.3]])
    head_on = environment_brdf(gold, torch.zeros(1), torch.ones(1))
    grazing = environment_brdf(gold, torch.zeros(1), torch.full((1,), 1e-3))
    torch.testing.assert_close(head_on, gold, atol=0.05, rtol=0)
    assert float(grazing.amin()) > 0.85
    aslant = environment_brdf(gold, torch.full((1,), 0.3), torch.full((1,), 0.3))[0]
    assert float(aslant[2] / aslant[0]) < 0.33


def test_too_bright_light_keeps_its_hue():
    shown = displayed(torch.tensor([[2.0, 1.4, 0.4], [0.2, 0.1, 0.0]]))
    assert bool((shown <= 1).all())
    assert float(shown[0, 0]) > float(shown[0, 1]) > float(shown[0, 2])


@pytest.fixture(scope="module")
def bronze(ball):
    """The ball in bronze."""
    _, scene, own, cameras = ball
    return in_material(scene, own, BRONZE, cameras)


def test_metal_is_nearer_to_its_exact_picture_than_paint(ball, bronze):
    lit, scene, own, cameras = ball
    finish = Finish(plain_base((0.725, 0.522, 0.314)), 1.0, 0.38)
    held_out = ring_cameras(lit.solid, 1, 64, elevation=33.0, start=-20.0)[0]
    paint = painted(scene, read_instruction("paint it #b98550").changes[0], own, cameras).scene
    errors = [subject_error(each, lit, held_out, finish) for each in (bronze.scene, paint, scene)]
    assert errors[0] < min(errors[1:])


def test_matte_material_is_right_on_the_mean_and_stays_at_degree_0(ball):
    lit, scene, own, cameras = ball
    finish = Finish(plain_base((0.2, 0.5, 0.55)), specular=0.0)
    held_out = ring_cameras(lit.solid, 1, 64, elevation=33.0, start=-20.0)[0]
    done = in_material(scene, own, Material("#33808c", roughness=1.0), cameras).scene
    assert done.degree == scene.degree == 0
    assert subject_error(done, lit, held_out, finish) < 0.08


def test_what_is_outside_keeps_its_bits_and_reflections_are_told(ball, bronze):
    (_, scene, own, _), done = ball, bronze
    kept = done.scene[~done.changed]
    assert torch.equal(done.origin[~done.changed], (~own).nonzero()[:, 0])
    assert torch.equal(kept.sh[:, :1], scene.sh[~own])
    assert not kept.sh[:, 1:].any()
    assert done.scene.degree == 3
    assert any("degree 3" in note for note in done.notes)
    assert same_bits(kept, scene[~own], but=("sh",))
    assert own[done.origin[done.changed]].all()


def test_what_a_picture_shows_is_shaded_about_as_in_the_whole(ball, bronze):
    _, scene, own, cameras = ball
    part = in_material(scene, own, BRONZE, cameras, shown=own).scene
    part, whole, before = (render_picture(s, cameras[0]) for s in (part, bronze.scene, scene))
    error, change = (part - whole).square().mean(), (before - whole).square().mean()
    assert error < 0.01 * change  # of fewer directions
    away = in_material(scene, own, BRONZE, cameras, shown=~own).scene
    assert not away.sh[:, 1:].any()


def test_a_bright_object_on_a_dark_tile_is_lit_by_a_studio(ball):
    _, scene, own, _ = ball
    low = ~own & (scene.means[:, 2] < -3)
    sh = scene.sh.clone()
    sh[low] = (0.08 - 0.5) / SH_DC
    tile = replace(scene, sh=sh)[own | low]
    made = in_material(tile, own[own | low], MATERIALS["silver"])
    assert any("studio" in note for note in made.notes)
    shown = 0.5 + SH_DC * made.scene.sh[made.changed, 0]
    assert float(shown.mean()) > 0.3


def test_moss_clings_to_what_faces_up_and_the_old_surface_shows_below(ball):
    lit, scene, own, cameras = ball
    after = in_material(scene, own, MATERIALS["moss"], cameras)
    rows = after.changed
    moved = (after.scene.sh - scene.sh[after.origin])[rows, 0].abs().mean(-1)
    height = after.scene.means[rows, 2] / lit.solid.radius
    assert float(moved[height > 0.6].mean()) > 2 * float(moved[height < -0.6].mean())


def test_needles_and_nothing_are_refused(ball):
    _, scene, own, cameras = ball
    lost = needles(600)
    with pytest.raises(UsageError, match="no surface"):
        in_material(lost, torch.ones(len(lost), dtype=torch.bool), BRONZE, cameras[::6])
    with pytest.raises(UsageError, match="no Gaussian"):
        in_material(scene, torch.zeros_like(own), BRONZE, cameras)


@pytest.fixture(scope="module")
def striped(ball):
    """The ball with a stripe of another hue, and the stripe's rows."""
    _, scene, own, _ = ball
    rows, sh = own & (scene.means[:, 2].abs() < 0.15), scene.sh.clone()
    sh[rows, 0] = (torch.tensor((0.1, 0.35, 0.1)) - 0.5) / SH_DC
    return replace(scene, sh=sh), rows


def test_a_finish_alone_keeps_the_colors_that_are_there(ball, striped):
    (_, _, own, cameras), (scene, _) = ball, striped
    turned = scene.with_degree(1)
    turned.sh[own, 2] = 0.3  # brighter from above, as a highlight is
    matte, glossy = (
        in_material(turned, own, material_of(f"{name} finish"), cameras).scene
        for name in ("matte", "glossy")
    )
    assert (matte.sh - scene.with_degree(1).sh).abs().max() * SH_DC < 0.02
    assert glossy.degree == 3


def test_a_dark_stripe_of_another_hue_goes(ball, striped):
    (_, scene, own, cameras), (over_stripes, rows) = ball, striped
    plain, over = (in_material(each, own, MATERIALS["plaster"], cameras).scene
                   for each in (scene, over_stripes))  # fmt: skip
    before = np.abs((over_stripes.sh - scene.sh)[rows, 0].numpy()).mean()
    after = np.abs((over.sh - plain.sh)[rows, 0].numpy()).mean()
    assert after < 0.4 * before


def test_a_larger_world_has_the_same_colors(ball):
    lit, scene, own, _ = ball
    high = scene.means[:, 2] > 3  # nothing is known of the sky, as in a capture that looks down
    scene, own = scene[~high], own[~high]
    cameras = ring_cameras(lit.solid, 6, 48, elevation=30.0)
    larger, cameras_there = (
        transform(scene, scale=100.0),
        [moved_camera(each, scale(100.0)) for each in cameras],
    )
    made = in_material(scene, own, MATERIALS["gold"], cameras).scene
    grown = in_material(larger, own, MATERIALS["gold"], cameras_there).scene
    pictures = [render_picture(made, cameras[0]), render_picture(grown, cameras_there[0])]
    assert float((pictures[0] - pictures[1]).abs().mean()) < 2e-3
