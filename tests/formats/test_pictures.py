"""Pictures in files hold the values of tensors."""

from __future__ import annotations

import numpy as np
import torch

from gsedit.formats.pictures import as_picture


def test_a_picture_holds_the_values():
    image = torch.tensor([[[0.0, 0.5, 1.0], [-1.0, 2.0, 0.2]]])
    assert np.array_equal(np.asarray(as_picture(image)), [[[0, 128, 255], [0, 255, 51]]])
