"""The history of a session: steps, undo, and the file that survives a kill."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from gsedit.app.document import (
    NAME,
    Document,
    Eye,
    Pending,
    Step,
    applied,
    load,
    moved,
    opened,
    save,
)
from gsedit.errors import InputError

BRONZE = Step("turn it into bronze", "steps/001/scene.ply", ("edit", "a.ply", "bronze"))
SNOW = Step("snow", "steps/002/scene.ply")


@pytest.fixture
def document() -> Document:
    return applied(applied(opened(Path("/a/a.ply"), Path("/a/a.ply"), "a.ply"), BRONZE), SNOW)


def test_undo_and_redo_go_back_and_forth_and_stop_at_the_ends(document):
    assert moved(document, 1).current == BRONZE
    assert moved(moved(document, 1), 2) == document == moved(document, 3)
    first = moved(document, -1)
    assert first.position == 0
    assert first.steps == document.steps
    assert moved(Document(), -2).position == -1


def test_a_step_after_an_undo_forgets_what_was_undone(document):
    other = applied(moved(document, 0), SNOW)
    assert [each.title for each in other.steps] == ["a.ply", "snow"]
    assert other.current == SNOW


def test_a_document_is_read_as_it_was_written(document, tmp_path):
    eye = Eye((0.0, 1.0, 2.5), (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 0.9)
    whole = replace(moved(document, 1), eye=eye, pending=Pending("rust", ("edit", "a.ply", "rust")))
    for each in (whole, document, Document()):
        save(each, tmp_path)
        assert load(tmp_path) == each
    save(document, tmp_path)
    assert document.current.scene == "steps/002/scene.ply"


@pytest.mark.parametrize(
    "change",
    [
        {"steps": 3}, {"steps": [{"title": "a"}]}, {"position": "two"}, {"source": None},
        {"eye": {"position": [0, 0, 1]}}, {"pending": {"title": "a", "command": "rm"}},
        {"eye": {"position": [0, 0, 1], "target": [0, 0, 0], "up": [0, 0, 1], "fov": 9}},
        {"eye": {"position": [0, 0], "target": [0, 0, 0], "up": [0, 0, 1], "fov": 1}},
    ],
)  # fmt: skip
def test_a_damaged_document_is_refused_by_its_place(change, document, tmp_path):
    save(document, tmp_path)
    record = json.loads((tmp_path / NAME).read_text())
    (tmp_path / NAME).write_text(json.dumps(record | change))
    with pytest.raises(InputError, match=NAME):
        load(tmp_path)
