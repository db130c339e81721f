"""How far the poses of a capture are from known ones, matched by the photos' names. The
capture's world is brought onto the known one by the best similarity of the camera centers.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gsedit.views.load import load_dataset


@dataclass(frozen=True)
class PoseError:
    """Medians over the photos that both have."""

    posed: int
    photos: int
    center: float
    """Distance of the centers, in the scene's size: the median distance of the known centers from
    their mean."""
    degrees: float
    """Angle between the cameras' axes."""


def pose_error(found: dict[str, np.ndarray], known: dict[str, np.ndarray]) -> PoseError:
    """`found` and `known`: world-to-camera matrices (4x4, OpenCV axes) by name."""
    names = sorted(set(found) & set(known))
    if len(names) < 3:
        raise SystemExit(f"{len(names)} photos have the same name in both: 3 are needed")
    a, b = (np.stack([np.linalg.inv(poses[name]) for name in names]) for poses in (found, known))
    from_a, from_b = (x[:, :3, 3] - x[:, :3, 3].mean(0) for x in (a, b))
    u, s, vt = np.linalg.svd(from_b.T @ from_a)  # Umeyama 1991
    turn = np.diag([1, 1, np.linalg.det(u @ vt)])
    rotation = u @ turn @ vt
    scale = (s @ np.diag(turn)) / (from_a**2).sum()
    distance = np.linalg.norm(from_b - scale * from_a @ rotation.T, axis=1)
    size = np.median(np.linalg.norm(from_b, axis=1))
    left = np.swapaxes(b[:, :3, :3], 1, 2) @ rotation @ a[:, :3, :3]
    cosine = (np.trace(left, axis1=1, axis2=2) - 1) / 2
    degrees = np.degrees(np.arccos(cosine.clip(-1, 1)))
    center = float(np.median(distance) / size)
    return PoseError(len(names), len(known), center, float(np.median(degrees)))


def poses(folder: Path) -> dict[str, np.ndarray]:
    """World-to-camera matrices of a dataset by the stem of the photo's name."""
    views = load_dataset(folder, size=16).views
    return {Path(v.name).stem: v.camera.world_to_camera.double().numpy() for v in views}
