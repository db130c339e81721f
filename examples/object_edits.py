"""One picture of what sentences do to an object: removed, halved, moved, and grown over.

python examples/object_edits.py bear.ply -o objects.jpg

The picture is of a camera that no edit looked through.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from contact_sheet import FRONT_PIXELS, cell, edits, grid, load_shown, save

SENTENCES = (
    "remove the bear",
    "make the bear half the size",
    "turn the bear around and make it bronze",
    "a thick layer of snow on the bear",
    "let moss grow on the bear",
    "cover the ground with fallen leaves",
    "remove the bear and make it night",
)
COLUMNS = 4

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Edits of one object in one picture.")
    parser.add_argument("scene", type=Path, help="a scene file, cameras.json beside")
    parser.add_argument("-o", "--output", type=Path, required=True, help="the picture, a .jpg")
    given = parser.parse_args()
    shown = load_shown(given.scene)
    scenes = [shown.scene, *edits(shown, SENTENCES)]
    labels = ["as captured", *(f'"{each}"' for each in SENTENCES)]
    cells = [(label, cell(each, shown.camera, FRONT_PIXELS)) for label, each in zip(labels, scenes)]
    save(grid([cells[:COLUMNS], cells[COLUMNS:]]), given.output)
