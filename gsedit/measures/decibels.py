"""PSNR and RMSE of colors in [0, 1]: PSNR = -20 log10(RMSE), dB. Needs no torch."""

from __future__ import annotations

from math import inf, log10


def psnr_from_rmse(rmse: float) -> float:
    """PSNR, dB, at an RMSE of 0 or more: infinity at 0, and NaN stays NaN."""
    return -20 * log10(rmse) if rmse else inf


def rmse_from_psnr(psnr: float) -> float:
    """RMSE at a PSNR in dB, the inverse of `psnr_from_rmse`: 0 at infinity."""
    return 10 ** (-psnr / 20)
