"""Journeys: the commands of the pages are found, and two runs are compared picture by picture."""

import csv
from dataclasses import asdict

import numpy as np
from PIL import Image
from research.journeys import NAMES, ROOT, Journey, compare, journeys_of, write_table


def test_the_pages_have_commands_each_with_a_folder_of_its_own():
    found = journeys_of(ROOT)
    assert len(found) > 50
    assert len({each.name for each in found}) == len(found)
    assert any(each.command.startswith("gsedit measure scene.ply") for each in found)


def test_a_comparison_tells_pictures_and_ends_that_differ(tmp_path):
    for folder, light, code in (("a", 100, 0), ("b", 110, 3)):
        (tmp_path / folder / "edit").mkdir(parents=True)
        pixels = np.full((8, 8, 3), light, dtype=np.uint8)
        Image.fromarray(pixels).save(tmp_path / folder / "edit" / "scene.png")
        rows = [asdict(Journey("p", "c", "edit", code))]
        write_table(tmp_path / folder / "commands.csv", NAMES, rows)
    compare(tmp_path / "a", tmp_path / "b", tmp_path / "table.csv")
    ends, picture = csv.DictReader((tmp_path / "table.csv").open())
    assert ends["note"] == "exit 0 and 3"
    assert picture["db"] == "28.13"
