"""Dropping SH bands: what is lost is told, and is what the colors lose."""

from dataclasses import replace

import numpy as np
import pytest
from splat_tables import random_table

from gsedit.scene.quaternions import even_directions, harmonics
from gsedit.toolkit import ReduceSH, apply
from gsedit.toolkit.reduce_sh import Lost


def test_the_loss_is_the_rmse_of_colors_over_directions():
    table = random_table(30, 3)
    table = replace(table, logit_opacities=np.zeros(30, np.float32))
    lost, said = Lost(), []
    lost.add(table, 4)
    less = apply(table, ReduceSH(1), say=said.append)
    values = harmonics(even_directions(20000), 3)
    before = np.einsum("dk,nkc->ndc", values, table.sh)
    after = np.einsum("dk,nkc->ndc", values[:, :4], less.sh)
    assert lost.rmse == pytest.approx(np.sqrt(np.mean((before - after) ** 2)), rel=1e-3)
    assert f"{lost.rmse:.4f} of 1" in said[0]
