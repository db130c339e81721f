"""Measure what the second and third click at one place take, by masks that were drawn by hand.

    python -m research.measure_parts ../shared/data parts.csv bear.ply garden-draft.ply ...

For each scene and each of its masks, clicks one to three times in the middle of the mask, at its
photo; writes the mean IoU of the region's render with all masks, and seconds.
"""

from __future__ import annotations

import csv
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import torch

from gsedit import load
from gsedit.select import Click, Selector
from gsedit.views.load import load_dataset
from research.measure_subjects import middle, read_truth

WANTED = {"bear": "bear", "garden": "vase", "dinosaur": "dino"}
"""Mask set of each capture; the dinosaur's is without its rock."""
CLICKS = 3


@torch.no_grad()
def rows_of(capture: Path, path: Path) -> Iterator[list[str]]:
    """A row for each click and how often it is given."""
    scene = load(path)
    selector = Selector(scene, [view.camera for view in load_dataset(capture).views])
    truth = read_truth(capture, [WANTED[capture.name]])
    for i, (camera, mask) in enumerate(zip(truth.cameras, truth.masks, strict=True)):
        click = Click(camera, *middle(mask))
        selector.at([click])  # what is found once
        for count in range(1, CLICKS + 1):
            start = time.perf_counter()
            region = selector.at([click] * count)
            seconds = time.perf_counter() - start
            ious = truth.iou(region, scene)
            told = [f"{sum(ious) / len(ious):.3f}", f"{seconds:.2f}", region.note]
            yield [capture.name, path.stem, str(i), str(count), *told]


def main(data: Path, out: Path, scenes: Sequence[Path]) -> None:
    """Write the table. A scene's file is named after its capture, as bear-draft.ply."""
    with out.open("w", newline="") as file:
        table = csv.writer(file)
        table.writerow(("capture", "fit", "mask", "clicks", "IoU", "s", "found"))
        for path in scenes:
            for row in rows_of(data / path.stem.split("-")[0], path):
                table.writerow(row)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), [Path(each) for each in sys.argv[3:]])
