"""PSNR and RMSE are inverse to each other, with one rule for no error."""

import pytest

from gsedit.measures.decibels import psnr_from_rmse, rmse_from_psnr


def test_an_rmse_of_a_tenth_is_20_db():
    assert psnr_from_rmse(0.1) == pytest.approx(20, abs=1e-12)
    assert rmse_from_psnr(20.0) == pytest.approx(0.1, abs=1e-15)


@pytest.mark.parametrize("rmse", [1e-12, 1e-3, 0.5, 1.0, 2.0])
def test_each_undoes_the_other(rmse):
    assert rmse_from_psnr(psnr_from_rmse(rmse)) == pytest.approx(rmse, rel=1e-12)
