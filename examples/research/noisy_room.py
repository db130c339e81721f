"""A room full of floaters, from few, noisy views and wrong points, and what clean gains there.

python -m research.noisy_room out/room 1   # a seed; writes room.ply, cameras.json, cleaned.ply
"""

import sys
from dataclasses import replace
from pathlib import Path

import torch
from torch import Tensor

import gsedit
from gsedit.datasets.cameras_json import write_beside
from gsedit.datasets.dataset import Dataset
from gsedit.fitting.fit import evaluate, fit
from gsedit.fitting.settings import FitSettings
from gsedit.synthetic import SyntheticScene, traced_dataset
from gsedit.synthetic.paint import checker, lit, mix, parts, plain, waves
from gsedit.synthetic.shapes import box, sphere, translate, union
from gsedit.toolkit import clean
from rasterizer import Camera
from rasterizer.camera import look_at


def room(draw: torch.Generator) -> SyntheticScene:
    """Walls 2.6 x 2.6 x 1.6 wide, and six boxes and balls on the floor, in random colors."""
    turns, reach, sizes = torch.rand(3, 6, generator=draw).tolist()
    coats = [
        mix(plain(a), plain(b), waves(0.4)) for a, b in torch.rand(6, 2, 3, generator=draw).tolist()
    ]
    things = []
    for i, (turn, far, size) in enumerate(zip(turns, reach, sizes)):
        size, angle = 0.12 + 0.15 * size, torch.tensor(torch.pi / 3 * i + turn)
        x, y = ((0.6 + 0.3 * far) * torch.stack((angle.cos(), angle.sin()))).tolist()
        solid, high = (box((size, size, 1.6 * size)), 1.6 * size) if i % 2 else (sphere(size), size)
        things.append(translate(solid, (x, y, high - 0.8)))
    hollow, (a, b) = box((1.3, 1.3, 0.8)), torch.rand(2, 3, generator=draw).tolist()
    painted = [
        (lambda points: -hollow(points), mix(plain(a), plain(b), checker(0.7))),
        *zip(things, coats),
    ]
    solid = union(*(each for each, _ in painted))
    black, up = torch.zeros(3, dtype=torch.float64), torch.tensor((0, 0, 1.0), dtype=torch.float64)
    return SyntheticScene(
        "room", solid, lit(parts(*painted), solid, (-0.3, -0.4, 0.9)), black, 2.0, up
    )


def cameras(
    scene: SyntheticScene, count: int, x: float, fov: float, draw: torch.Generator
) -> list[Camera]:
    """Near the plane x, out of all things, looking at the far wall; 128 x 128 pixels."""
    made: list[Camera] = []
    while len(made) < count:
        a, b, c, d, e = (2 * torch.rand(5, generator=draw, dtype=torch.float64) - 1).tolist()
        eye = torch.tensor((x + 0.1 * a, 0.6 * b, 0.15 + 0.3 * c), dtype=torch.float64)
        if float(scene.sdf(eye[None])) > 0.2:
            made.append(
                look_at(eye, eye.new_tensor((1.0, 0.5 * d, 0.3 * e - 0.2)), scene.up, fov, 128, 128)
            )
    return made


def capture(scene: SyntheticScene, seed: int) -> Dataset:
    """12 photos with noise of 0.1, of which `fit` holds out 2, and 4,000 points, 30 % anywhere."""
    draw = torch.Generator().manual_seed(seed + 1)
    exact = traced_dataset(scene, cameras(scene, 12, -0.5, 70.0, draw), seed=seed)

    def noisy(image: Tensor) -> Tensor:
        return (image + 0.1 * torch.randn(image.shape, generator=draw)).clamp(0, 1)

    views = tuple(replace(view, image=noisy(view.image)) for view in exact.views)
    anywhere = (torch.rand(4000, 3, generator=draw) - 0.5) * torch.tensor((2.4, 2.4, 1.5))
    wrong = torch.rand(4000, 1, generator=draw) < 0.3
    assert exact.points is not None
    return Dataset(views, torch.where(wrong, anywhere, exact.points), exact.point_colors)


def main(folder: Path, seed: int) -> None:
    scene = room(torch.Generator().manual_seed(seed))
    photos = capture(scene, seed)
    settings = FitSettings(steps=1200, seconds=None)
    fitted = fit(photos, settings, generator=torch.Generator().manual_seed(seed)).scene
    held_out = cameras(scene, 10, -1.0, 50.0, torch.Generator().manual_seed(seed + 2))
    truth, used = traced_dataset(scene, held_out).views, photos.split()[0]
    for name, each in (
        ("room", fitted),
        ("cleaned", clean(fitted, cameras=[v.camera for v in used])),
    ):
        gsedit.save(each, folder / f"{name}.ply", overwrite=True)
        sys.stdout.write(f"{name}: {len(each):,} Gaussians, {evaluate(each, truth):.2f} dB\n")
    write_beside(folder / "room.ply", used, overwrite=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]))
