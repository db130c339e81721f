"""The pictures of docs/howto/recolor.md."""

from __future__ import annotations

import numpy as np
from PIL import Image
from research.make_paintings import paintings


def test_three_pictures_of_their_colors(tmp_path):
    paintings(tmp_path)
    means = {p.stem: np.asarray(Image.open(p)).mean((0, 1)) for p in tmp_path.iterdir()}
    assert set(means) == {"night", "autumn", "woodcut"}
    assert means["night"].argmax() == 2
    assert means["autumn"].argmax() == 0
    assert np.ptp(means["woodcut"]) < 40
