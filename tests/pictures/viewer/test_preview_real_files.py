"""Every splat file of the real data previews."""

from __future__ import annotations

import numpy as np
import pytest
from shared_data import DATA

from gsedit.errors import GseditError, UsageError
from gsedit.formats.scenes import load
from gsedit.pictures.viewer.preview import preview

FILES = (
    "banana.splat",
    "biker.compressed.ply",
    "biker.spz",
    "guitar.compressed.ply",
    "playbot/3_0",
    "playbot/4_0",
)


@pytest.mark.parametrize("name", FILES)
def test_a_real_file_previews(name, tmp_path):
    from PIL import Image

    path = DATA / "splats" / name
    if not path.exists():
        pytest.skip(f"{path} is not there")
    try:
        preview(load(path, drop_invalid=True), tmp_path / "a.png", size=(80, 60))
    except UsageError:
        raise
    except GseditError as error:
        pytest.skip(f"no OpenGL here: {error}")
    picture = np.asarray(Image.open(tmp_path / "a.png"))
    assert 0.02 < (picture < 250).any(-1).mean() < 0.95
