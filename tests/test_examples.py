"""The examples run, and leave what they promise."""

from __future__ import annotations

import json

import pytest
import torch
from bench import row
from demo import demo
from scenes import random_cloud

from gsedit.report import read_events
from gsedit.synthetic import ring_cameras, scenes


def test_the_demo_leaves_its_folder(tmp_path):
    folder = tmp_path / "demo"
    with pytest.raises(SystemExit) as ended:
        demo(folder, count=1500, size=64, steps=10)
    assert ended.value.code == 0
    names = {"scene.ply", "edit.json", "metrics.jsonl", "before_after.png", "error_vs_time.png"}
    assert names == {p.name for p in folder.iterdir()}
    record = json.loads((folder / "edit.json").read_text())
    assert record["instruction"] == "turn the bear into a bronze statue"
    events = read_events(folder / "metrics.jsonl")
    assert events[-1].stage == "measure"
    assert events[-1].error is not None


def test_a_row_of_the_benchmark_has_error_and_time():
    cells = row("cloud", random_cloud(50, 0).to(torch.float32), ring_cameras(scenes()[0], 1, 24)[0])
    assert len(cells.strip("|").split("|")) == 8
