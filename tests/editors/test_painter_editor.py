"""The painter as an editor: strength, colors, pictures as styles, strokes."""

from dataclasses import replace
from types import SimpleNamespace

import pytest
import tiny_edits
import torch
from PIL import Image

import gsedit
from gsedit import EditSettings
from gsedit.errors import UsageError
from gsedit.paper import edit_views, session
from gsedit.paper.diffusion.settings import SamplerSettings
from gsedit.paper.editors import EditBatch, make_editor
from gsedit.paper.editors.painter.drawn import DRAWN, drawn
from gsedit.paper.editors.protocol import Places
from gsedit.scene.color_space import LUMINANCE
from gsedit.views.dataset import View
from gsedit.words.lexicon import LIKE
from rasterizer.render import render

PROMPT = "like van gogh"
VAN_GOGH = "starry night painting"


def pictures(count, side=32, seed=0):
    noise = torch.rand(
        count, 3, side // 8, side // 8, generator=torch.Generator().manual_seed(seed)
    )
    return torch.nn.functional.interpolate(noise, scale_factor=8, mode="bilinear").movedim(1, -1)


def painted(editor, originals, *names):
    batch, editor = EditBatch(originals, originals, ""), editor.in_styles(names or (VAN_GOGH,))
    (step,) = editor.edit(batch, SamplerSettings(), torch.Generator())
    return step.images


def close(a, b, tolerance=1e-4):
    torch.testing.assert_close(a, b, rtol=0, atol=tolerance)


def test_a_view_is_painted_alike_in_any_batch_and_precision():
    views, editor = pictures(4), make_editor("painter")
    double = painted(editor, views[:1].double())
    assert double.dtype == torch.float64
    close(double.float(), painted(editor, views[:1]))
    close(painted(editor, views), torch.cat([painted(editor, view[None]) for view in views]))


@pytest.mark.parametrize("style", [VAN_GOGH, *DRAWN])
def test_a_picture_of_one_color_noise_and_a_strip_are_painted_in_range(style):
    for picture in (torch.zeros(1, 16, 16, 3), pictures(1).round(), pictures(1, 1000)[:, :16]):
        made = painted(make_editor("painter"), picture, style)
        close(made, made.clamp(0, 1).reshape(picture.shape), 0)  # which what is not finite is not


def test_strength_leads_from_the_picture_to_the_painting():
    views = pictures(1)
    whole, half, none = (
        painted(make_editor("painter", strength=share), views) for share in (1.0, 0.5, 0.0)
    )
    close(none, views)
    close(half, (whole + views) / 2)
    with pytest.raises(UsageError, match="strength 2"):
        make_editor("painter", strength=2.0)


def test_colors_are_kept():
    views = 0.4 + 0.2 * pictures(1)
    made = painted(make_editor("painter", keep_colors=True, strength=0.3), views)
    luma = torch.tensor(LUMINANCE, dtype=torch.float32)
    chroma = [each - (each @ luma)[..., None] for each in (made, views)]
    close(*chroma)
    assert (made - views).abs().mean() > 0.01


def test_a_picture_gives_the_style(tmp_path):
    path = tmp_path / "waves.png"
    Image.fromarray((pictures(1, 64, seed=1)[0] * 255).byte().numpy()).save(path)
    editor, views = make_editor("painter", like=path), pictures(1)
    assert editor.name == "painter, like waves.png"
    assert (painted(editor, views, LIKE) - views).abs().mean() > 0.01
    with pytest.raises(UsageError, match="is not the style of waves"):
        editor.in_styles((VAN_GOGH,))
    with pytest.raises(UsageError, match="--like"):
        make_editor("painter").in_styles((LIKE,))
    with pytest.raises(UsageError, match="in_styles"):
        make_editor("painter").check(PROMPT)


def test_styles_that_are_named_together_are_mixed():
    editor, views = make_editor("painter"), pictures(1)
    names = (("impasto",), ("batik",), ("impasto", "batik"))
    first, second, both = (painted(editor, views, *each) for each in names)
    assert min((both - first).abs().mean(), (both - second).abs().mean()) > 0.01


def test_strokes_around_an_object_are_left_out():
    """A tiny edit, whole: painted where something is, fitted by a solve and then in steps."""
    scene, views = tiny_edits.scene(), tiny_edits.data()
    settings = EditSettings(batches=1, held_out_edits=0, brush=6.0)
    result = gsedit.edit(scene, PROMPT, views, settings=settings)
    for view in result.targets:
        nothing = render(scene, view.camera).alpha < 1e-6
        assert nothing.any()
        assert view.image[nothing].max() < 0.01  # pieces reach a little farther
    assert any(event.stage == "strokes" for event in result.events)
    origin = result.origin
    assert not torch.equal(result.scene.sh[:, 0], scene.sh[origin, 0])
    off = (result.scene.means - scene.means[origin]).abs().amax(1)
    assert (off <= 3 * scene.scales[origin].amax(1)).all()


def places_at(left, side=128):
    """A wall, looked at from so many pixels on."""
    y, x = torch.meshgrid(torch.arange(side), left + torch.arange(side), indexing="ij")
    points = torch.stack((x, y, 0 * x), -1).double()[None]
    return Places(torch.ones(1, side, side), points, torch.tensor((-1.0, -1.0, 0.0)), (0.0, 1.0))


def test_places_are_by_one_lens_and_tones_by_what_is_there():
    camera = tiny_edits.data().views[0].camera
    wide = replace(camera, fx=1.5 * camera.fx, fy=1.5 * camera.fy)
    views = [View("", each, torch.zeros(48, 48, 3)) for each in (camera, wide)]
    request = SimpleNamespace(scene=tiny_edits.scene(), every_view=views, settings=EditSettings())
    seen = object.__new__(session.Session)
    vars(seen).update(request=request, unedited=session.UneditedRenders(request))
    assert seen.unedited.tones[0] > 0.1  # black where nothing is does not count
    at, other = edit_views._places(seen, (0, 1)).points[:, 24, 24]
    assert (at - other).norm() < 1.0 < 0.1 * at.norm()


@pytest.mark.parametrize("style", sorted(DRAWN.keys() - {"sketch"}))
def test_what_is_drawn_by_rules_is_at_the_same_place_in_all_views(style):
    wall, shift = pictures(1, 192).double(), ((0, 0), (32, 32), (32, 3))
    first, second, moved = (
        drawn(style, wall[:, :128, at : at + 128], places_at(left))[:, 40:88, 72 - at : 88 - at]
        for at, left in shift
    )
    assert (first - second).abs().mean() < 0.05 < first.std()
    assert style in ("comic", "blueprint") or (moved - first).abs().mean() > 0.05


def test_a_sketch_has_contours_where_depth_jumps_and_none_of_grain():
    grain = torch.rand(1, 64, 64, 1, generator=torch.Generator().manual_seed(0))
    even = (0.5 + 0.1 * grain).expand(-1, -1, -1, 3)
    depths = torch.where(torch.arange(64) < 32, 1.0, 2.0).expand(1, 64, -1)
    editor = make_editor("painter").in_styles(("sketch",))
    places = places_at(0, 64)._replace(depths=depths)
    flat, stepped = (editor.pictures(even, each)[0, 8:56, :, 0] for each in (None, places))
    assert flat[:, 28:36].mean() > 0.7
    line = stepped[:, 28:36].mean(0)
    assert line[:4].min() < 0.3 < 0.6 < line[4:].min()  # on the near side


def test_a_sketch_leaves_no_color_of_the_scene_from_any_side():
    scene, views = tiny_edits.scene(), tiny_edits.data()
    sh = torch.cat((scene.sh[:, :1], torch.ones(len(scene), 15, 3)), 1)
    settings = EditSettings(batches=1, held_out_edits=0, brush=6.0)
    made = gsedit.edit(replace(scene, sh=sh), "draw it in pencil", views, settings=settings).scene
    torch.testing.assert_close(made.sh, made.sh[..., :1].expand_as(made.sh), rtol=0, atol=0.02)
    assert not made.sh[:, 1:].any()
