"""antimatter15's .splat: rows of 32 bytes, no header, no SH, linear scales and opacities."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch

from gsedit.errors import InputError
from gsedit.files.quantised import finite_logits
from rasterizer.numerics import SH_DC
from rasterizer.scene import Gaussians

ROW = np.dtype([("means", "<f4", 3), ("scales", "<f4", 3), ("rgba", "u1", 4), ("quats", "u1", 4)])


def read_splat(path: Path) -> Gaussians:
    """Read a .splat. Raises InputError for one that was cut off."""
    if path.stat().st_size % ROW.itemsize:
        raise InputError(
            f"{path} is no whole number of {ROW.itemsize}-byte rows: "
            "it is cut off, copy or export it again"
        )
    rows = np.fromfile(path, ROW)
    scales = torch.from_numpy(rows["scales"].copy())
    rgba = torch.from_numpy(rows["rgba"]).float() / 255
    quats = (torch.from_numpy(rows["quats"]).float() - 128) / 128
    # exporters round tiny scales to 0: the smallest normal float keeps the logarithm finite
    log_scales = torch.where(scales == 0, torch.finfo().tiny, scales).log()
    means = torch.from_numpy(rows["means"].copy())
    sh = (rgba[:, None, :3] - 0.5) / SH_DC
    return finite_logits(Gaussians(means, quats, log_scales, rgba[:, 3].logit(), sh))
