"""Peak memory and time of reading and fitting many photos, in a process of its own.

    python -m research.measure_photos [photos] [width] [height] [steps] [--lens]

The photos are JPEGs of a smooth texture with noise, on a ring about the origin, in a temporary
folder; `--lens`: with distortion, which is undone at each reading.
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import torch
from PIL import Image

import gsedit
from gsedit.fitting.fit import fit
from gsedit.fitting.settings import FitSettings
from gsedit.synthetic import demo_scene, ring_cameras

DIFFERENT = 6
"""Photos; the others are links to them."""


def write_photos(folder: Path, count: int, width: int, height: int, lens: bool) -> None:
    """Write a nerfstudio dataset."""
    (folder / "images").mkdir(parents=True)
    y, x = np.mgrid[:height, :width] / height
    draw, frames = np.random.default_rng(0), []
    for i, camera in enumerate(ring_cameras(demo_scene(), count, width)):
        file = folder / f"images/{i:03d}.jpg"
        if i < DIFFERENT:
            waves = np.stack([np.sin(x * (5 + c) + i) + np.cos(y * c - i) for c in range(3)], -1)
            picture = 127 + 50 * waves + 8 * draw.random((height, width, 1))
            Image.fromarray(picture.astype(np.uint8)).save(file, quality=90)
        else:
            file.hardlink_to(folder / f"images/{i % DIFFERENT:03d}.jpg")
        pose = torch.linalg.inv(camera.world_to_camera)
        pose[:3, 1:3] *= -1
        frames.append({"file_path": f"images/{file.name}", "transform_matrix": pose.tolist()})
    record = {"w": width, "h": height, "fl_x": 0.9 * width, "k1": 0.05 * lens, "frames": frames}
    (folder / "transforms.json").write_text(json.dumps(record))


def measure(folder: Path, steps: int) -> None:
    """Read and fit; print the seconds of CPU and the peak of resident memory."""
    begin = time.process_time()
    data = gsedit.load_dataset(folder)
    read = time.process_time() - begin
    settings = FitSettings(steps=steps, seconds=None, evaluations=1)
    result = fit(data, settings)
    spent = time.process_time() - begin - read
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    sys.stdout.write(
        f"{len(data)} photos: listed in {read:.1f} s of CPU, read and fitted for {result.steps} "
        f"steps in {spent:.1f} s; peak {peak:.2f} GB\n"
    )


if __name__ == "__main__":
    words = [word for word in sys.argv[1:] if word != "--lens"]
    if words[:1] == ["--child"]:
        measure(Path(words[1]), int(words[2]))
    else:
        given = [int(word) for word in words]
        count, width, height, steps = given + [300, 1920, 1080, 4][len(given) :]
        with tempfile.TemporaryDirectory() as made:
            write_photos(Path(made) / "photos", count, width, height, "--lens" in sys.argv)
            child = [sys.executable, __file__, "--child", f"{made}/photos", str(steps)]
            subprocess.run(child, check=True)
