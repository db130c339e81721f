"""Points that pictures have in common, by SIFT: neither a scene nor its depth is asked.

`h w` pixels; positions are in pixels, with pixel centers at +0.5.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.capture import stages
from gsedit.capture.settings import Attempt
from gsedit.capture.stages import LOG
from gsedit.errors import UsageError
from gsedit.formats.pictures import as_picture, save_picture
from gsedit.run.events import returned
from rasterizer.camera import Camera

FEATURES = 4096
"""Most features of a picture: pictures of 512 pixels have fewer."""
THREADS = 1
"""One, so that the same pictures have the same matches on every machine."""


def match_pictures(
    pictures: Mapping[int, Float[Tensor, "h w 3"]],
    cameras: Mapping[int, Camera],
    pairs: Sequence[tuple[int, int]],
) -> dict[tuple[int, int], tuple[Float[Tensor, "m 2"], Float[Tensor, "m 2"]]]:
    """Positions of the same `m` points in both pictures of each pair: matches of SIFT features that
    agree with one relative pose of the two cameras, whose focal lengths are known.

    A pair without such points is left out. COLMAP runs in a child process. Raises UsageError for
    cameras that are not pinholes, GseditError where COLMAP fails.
    """
    if any(camera.model != "pinhole" for camera in cameras.values()):
        raise UsageError("points are matched in pictures of pinhole cameras only")
    rough = Attempt(FEATURES)
    with TemporaryDirectory() as place:
        folder = Path(place)
        images = folder / "images"
        images.mkdir()
        for i, picture in pictures.items():
            save_picture(as_picture(picture), images / _name(i))
        listing = folder / "pairs.txt"
        listing.write_text("".join(f"{_name(a)} {_name(b)}\n" for a, b in pairs))
        request = {
            "database": str(folder / "matches.db"), "images": str(images), "pairs": str(listing),
            "groups": [
                {"names": [_name(i)], "model": "PINHOLE", "params": [c.fx, c.fy, c.cx, c.cy]}
                for i, c in cameras.items()
            ],
            "size": max(max(picture.shape[:2]) for picture in pictures.values()),
            "features": FEATURES, "peak": rough.peak, "threads": THREADS,
        }  # fmt: skip
        found = returned(stages.run("points", request, folder / LOG))["pairs"]
    matches = {}
    for each in found:
        a, b = (int(Path(name).stem) for name in each["names"])
        matches[a, b] = (torch.tensor(each["first"]), torch.tensor(each["second"]))
    return matches


def _name(i: int) -> str:
    return f"{i}.png"
