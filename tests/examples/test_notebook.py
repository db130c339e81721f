"""The notebook runs from its first cell to its last, on a few small photos."""

import os
import sys
from pathlib import Path

import pytest
from lens_photos import take, walk

nbformat = pytest.importorskip("nbformat", reason="needs gsedit[dev]")
nbclient = pytest.importorskip("nbclient", reason="needs gsedit[dev]")
pytest.importorskip("ipykernel", reason="needs gsedit[dev]")

FILE = Path(__file__).parents[2] / "examples" / "notebook" / "photos_to_edit.ipynb"
SMALL = "PHOTOS, MINUTES, SIZE, SENTENCE = 'small', 0.01, 48, 'make it darker'"


def test_photos_become_an_edited_scene_and_a_page(tmp_path):
    notebook = nbformat.read(FILE, as_version=4)
    assert not any(cell.get("outputs") for cell in notebook.cells)
    (given,) = [cell for cell in notebook.cells if "parameters" in cell.metadata.get("tags", ())]
    given.source += f"\n{SMALL}"
    take(tmp_path / "small", walk(8, degrees=112))
    programs = Path(sys.executable).parent
    environment = {**os.environ, "PATH": f"{programs}{os.pathsep}{os.environ['PATH']}"}
    client = nbclient.NotebookClient(
        notebook, timeout=120, resources={"metadata": {"path": tmp_path}}
    )
    client.execute(env=environment)
    shown = [
        kind
        for cell in notebook.cells
        for output in cell.get("outputs", ())
        for kind in output.get("data", ())
    ]
    assert {"image/png", "text/html"} <= set(shown)
    assert (tmp_path / "out" / "page.html").stat().st_size > 100_000
    assert (tmp_path / "out" / "snow.ply").is_file()
