"""A contact sheet shows what it is given, in rows of the same views."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from gsedit import View
from gsedit.pictures import contact_sheet as sheets
from gsedit.pictures.contact_sheet import contact_sheet
from rasterizer import Camera


def view(color: float, size: tuple[int, int] = (20, 30)) -> View:
    height, width = size
    pose = torch.eye(4, dtype=torch.float64)
    camera = Camera(pose, 30.0, 30.0, width / 2, height / 2, width, height)
    return View("v", camera, torch.full((height, width, 3), color))


def test_contact_sheet_shows_every_row_and_at_most_the_columns():
    rows = [("original", [view(0.0)] * 10), ("edited", [view(1.0)] * 10)]
    wide, narrow = contact_sheet(rows), contact_sheet(rows, columns=2)
    assert wide.height == narrow.height
    assert (wide.width - sheets.MARGIN) == 4 * (narrow.width - sheets.MARGIN)
    single = contact_sheet(rows[:1], columns=2)
    assert single.height < narrow.height
    dark = np.asarray(narrow.convert("L")) < 10
    pictures = (
        2 * sheets.CELL_PIXELS[0] * round(sheets.CELL_PIXELS[0] * 20 / 30)
    )  # two black pictures, enlarged
    assert dark.sum() == pytest.approx(pictures, rel=0.05)  # and the ink of two labels
