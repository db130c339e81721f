"""Notebooks show pictures of scenes and results, quickly, and never an error."""

from __future__ import annotations

import math
import subprocess
import sys
from dataclasses import replace
from io import BytesIO

import numpy as np
import torch
from PIL import Image
from point_clouds import ball

from gsedit import FitResult
from gsedit.pictures import notebook


def picture(png: bytes | None) -> np.ndarray:
    assert png is not None
    return np.asarray(Image.open(BytesIO(png))).astype(int)


def test_a_scene_is_a_picture_with_its_count_below():
    shown = picture(ball()._repr_png_())
    width, height = notebook.SIZE_PIXELS
    assert shown.shape == (height + 20, width, 3)
    assert (shown[:height, :, 0] - shown[:height, :, 1] > 100).sum() > 1000  # the ball is red
    assert (shown[height:] < 128).any()
    assert repr(ball()) == "Gaussians(200, SH degree 0, float32)"


def test_a_notebook_never_sees_an_error():
    nothing = ball()[:0]
    assert nothing._repr_png_() is None
    broken = replace(ball(), means=torch.full((200, 3), torch.nan))
    broken._repr_png_()
    assert FitResult(nothing, math.nan, 0, 0.0, ())._repr_html_() is None


def test_the_renderer_alone_shows_text():
    code = (
        "import torch, sys; from rasterizer import Gaussians\n"
        "s = Gaussians(*(torch.zeros(s) for s in ((1, 3), (1, 4), (1, 3), (1,), (1, 1, 3))))\n"
        "assert s._repr_png_() is None\n"
        "assert not any(name.startswith('gsedit') for name in sys.modules)\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_a_fit_shows_its_numbers_and_its_scene():
    fit = FitResult(ball(), 23.456, 1500, 60.0, ())
    html = fit._repr_html_()
    assert html is not None
    assert "23.5 dB" in html
    assert "1,500" in html
    assert "data:image/png;base64," in html
    assert picture(fit._repr_png_()).shape[1] == notebook.SIZE_PIXELS[0]
    assert repr(fit) == "FitResult(Gaussians(200, SH degree 0, float32), 23.5 dB, 1500 steps)"
