"""The measure of render's formats: what is exact is exact, and a better quality costs more."""

from __future__ import annotations

import pytest
import torch
from research.measure_rendering import main

import gsedit
from gsedit.synthetic import demo_scene, surface_gaussians


def test_formats_are_measured(tmp_path, capsys):
    pytest.importorskip("av")
    scene = surface_gaussians(demo_scene(), 300, torch.Generator().manual_seed(0))
    gsedit.save(scene, tmp_path / "scene.ply")
    main([str(tmp_path / "scene.ply")], sizes=(16, 32), frames=4)
    speeds, formats = capsys.readouterr().out.split("\n\n")
    assert speeds.count("\n") == 3
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in formats.splitlines()[2:]]
    psnr = {row[0]: float(row[3]) for row in rows}
    assert psnr[".npy"] == 200
    assert psnr[".exr"] > 130
    assert 52 < psnr[".png"] < 70
    assert psnr[".mp4, crf 12"] > psnr[".mp4, crf 18"] > psnr[".mp4, crf 28"] > 15
