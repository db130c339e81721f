"""A picture's style: colors come near, edges stay, nothing but colors moves; same seed, same."""

from __future__ import annotations

import pytest
import torch

from gsedit import Dataset, orbit
from gsedit.editing.style.studio import StyleLoss, StyleSettings
from gsedit.editing.style.style import style
from gsedit.measures.features import FilterBank
from gsedit.views.dataset import capture
from rasterizer import Gaussians


@pytest.fixture(scope="module")
def ball() -> Gaussians:
    """A ball of Gaussians of many colors."""
    draw = torch.Generator().manual_seed(0)
    count = 300
    means = torch.nn.functional.normalize(torch.randn(count, 3, generator=draw), dim=-1)
    sh = torch.zeros(count, 4, 3)
    sh[:, 0] = torch.tensor([0.3, 0.1, -0.2]) + 0.8 * torch.randn(count, 3, generator=draw)
    return Gaussians(
        means=means,
        quats=torch.randn(count, 4, generator=draw),
        log_scales=-2.3 + 0.2 * torch.randn(count, 3, generator=draw),
        logit_opacities=torch.full((count,), 4.0),
        sh=sh,
    )


@pytest.fixture(scope="module")
def views(ball) -> Dataset:
    cameras = orbit(ball, 9, 48)
    return Dataset(capture(ball, cameras, [str(i) for i in range(len(cameras))]))


@pytest.fixture(scope="module")
def stripes() -> torch.Tensor:
    """From blue to yellow, with stripes 4 pixels wide."""
    across = torch.linspace(0, 1, 48)[:, None, None].expand(48, 48, 3)
    plain = torch.lerp(torch.tensor([0.1, 0.2, 0.6]), torch.tensor([0.8, 0.7, 0.3]), across)
    return plain + 0.1 * (torch.arange(48) // 4 % 2)[None, :, None]


EVERYWHERE = torch.ones(48, 48)
SHORT = StyleSettings(steps=12, views=3)


@pytest.fixture(scope="module")
def result(ball, views, stripes):
    return style(ball, stripes, dataset=views, settings=SHORT)


def test_colors_come_near_and_edges_stay(result):
    before, colors, texture = result.measures
    assert (before.stage, colors.stage, texture.stage) == ("before", "colors", "texture")
    assert colors.color_distance < 0.7 * before.color_distance
    assert texture.color_distance < before.color_distance
    assert before.structure == pytest.approx(1, abs=1e-5)
    assert texture.structure > 0.5


def test_only_colors_move(ball, result):
    for name in ("means", "quats", "log_scales", "logit_opacities"):
        assert torch.equal(getattr(result.scene, name), getattr(ball, name))
    assert not torch.allclose(result.scene.sh, result.colored.sh, atol=1e-3)


def test_what_is_not_selected_stays(ball, views, stripes):
    styled = style(ball, stripes, dataset=views, settings=SHORT, where="y > 0").scene
    outside = ball.means[:, 1] <= 0
    assert torch.equal(styled.sh[outside], ball.sh[outside])
    assert (styled.sh[~outside, 0] - ball.sh[~outside, 0]).abs().amax(-1).median() > 0.05


def test_the_loss_is_0_at_the_style_itself_and_falls_towards_it(stripes):
    loss = StyleLoss(stripes, FilterBank(), content=0.0)
    assert float(loss(stripes, stripes, EVERYWHERE)) == pytest.approx(0, abs=1e-6)
    grey = torch.full_like(stripes, 0.5)
    half = torch.lerp(grey, stripes, 0.7)
    assert float(loss(half, grey, EVERYWHERE)) < float(loss(grey, grey, EVERYWHERE))
    kept = StyleLoss(stripes, FilterBank(), content=1.0)
    assert float(kept(half, grey, EVERYWHERE)) > float(loss(half, grey, EVERYWHERE))
