"""Planes fitted to points, also where the points do not decide it."""

import numpy as np
import pytest

from gsedit.scene.planes import refined_plane


@pytest.mark.parametrize("across", [0.0, 1e-9, 1.0])
def test_a_fitted_plane_has_a_normal_of_length_1_also_for_points_in_a_line(across):
    line = np.zeros((9, 3))
    line[:, 0] = np.linspace(0, 1, 9)
    line[::2, 1] = across
    normal, offset = refined_plane(line, np.array([0.0, 0.0, 1.0]), 0.0, 0.1)
    assert np.linalg.norm(normal) == pytest.approx(1)
    assert np.abs(line @ normal - offset).max() < 0.1
