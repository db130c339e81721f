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


def test_columns_that_stand_apart_are_all_shown_and_may_have_gaps():
    rows = [("original", [view(0.0)] * 12), ("edited", [*[view(1.0)] * 10, view(0.0), None])]
    sheet = contact_sheet(rows, columns=4, apart=2, caption="held out")
    plain = contact_sheet([(label, views[:4]) for label, views in rows], columns=4)
    assert sheet.width == plain.width + sheets.GAP
    dark = np.asarray(sheet.convert("L")) < 10
    one = sheets.CELL_PIXELS[0] * round(sheets.CELL_PIXELS[0] * 20 / 30)
    assert dark.sum() == pytest.approx(5 * one, rel=0.05)  # 4 of the first row, 1 of the second


def test_contact_sheet_refuses_rows_that_do_not_match():
    with pytest.raises(ValueError, match="equal"):
        contact_sheet([("a", [view(0.0)]), ("b", [view(0.0), view(1.0)])])
    with pytest.raises(ValueError, match="non-zero"):
        contact_sheet([])
