"""A 2D editor of your own, and the built-in bear edited with it: about half a minute.

python examples/write_an_editor.py out/fade

In a package of yours, these lines of pyproject.toml add it to `gsedit list editors`, and then
`gsedit edit scene.ply "fade it" -o out --editor fade` uses it:

    [project.entry-points."gsedit.editors"]
    fade = "your_package.your_module:Fade"
"""

from __future__ import annotations

import sys
from pathlib import Path

import torch

import gsedit
from gsedit.bench.synthetic import demo_scene, surface_gaussians
from gsedit.formats.pictures import save_picture
from gsedit.paper.editors import Capabilities, EditProgress
from gsedit.pictures.contact_sheet import contact_sheet
from gsedit.views.around import around


class Fade:
    """Bleaches pictures, each view a little differently, as real editors do."""

    name, cell = "fade", 2  # cell: pixels of the grid on which corresponding surface is wanted
    capabilities = Capabilities()  # nothing optional

    def check(self, prompt: str) -> None:
        if "fade" not in prompt:
            raise gsedit.UsageError('this editor only fades: say so, as in "fade it"')

    def edit(self, batch, settings, generator):
        amounts = 0.6 + 0.2 * torch.rand(len(batch.originals), generator=generator)
        edited = batch.images.clone()  # anchored views are finished: they stay as they are
        for i, amount in enumerate(amounts.tolist()):
            if batch.anchored is None or not batch.anchored[i]:
                pale = batch.originals[i].mean(-1, keepdim=True).sqrt()
                edited[i] = torch.lerp(batch.originals[i], pale, amount)
            yield EditProgress(i + 1, len(amounts) + 1)
        yield EditProgress(len(amounts) + 1, len(amounts) + 1, edited)


def run(folder: Path, count: int = 10_000, size: int = 256, **options) -> None:
    """Edit, and leave the scene and a sheet of originals, edited pictures and renders."""
    scene = surface_gaussians(demo_scene(), count, torch.Generator().manual_seed(0))
    data = around(scene, size, up=torch.tensor([0, 0, 1]).double())
    result = gsedit.edit(scene, "fade it", editor=Fade(), views=data, **options)
    gsedit.save(result.scene, folder / "scene.ply", overwrite=True)
    rows = [("original", result.originals), ("Fade", result.targets), ("scene", result.finals)]
    save_picture(contact_sheet(rows), folder / "before_after.png", overwrite=True)


if __name__ == "__main__":
    run(Path(sys.argv[1] if len(sys.argv) > 1 else "out/fade"))
