"""Figures of error against run time, whatever was measured."""

import numpy as np
import pytest
from PIL import Image

from gsedit import Event
from gsedit.errors import UsageError
from gsedit.pictures.figures import error_vs_time


@pytest.mark.parametrize(
    "events",
    [
        [],
        [Event("fit", 1.0, loss=0.2)],
        [Event("fit", t, error=0.1 / t) for t in (1.0, 2.0)],
        [Event("fit", 1.0, loss=-0.1), Event("fit", 2.0, loss=float("nan"), error=1e-320)],
    ],
    ids=["empty", "loss", "error", "extreme"],
)
def test_error_vs_time_is_a_picture_whatever_was_measured(tmp_path, events):
    path = tmp_path / "curve.png"
    error_vs_time(events, path)
    assert np.asarray(Image.open(path).convert("L")).std() > 0
    with pytest.raises(UsageError, match="exists"):
        error_vs_time(events, path)
