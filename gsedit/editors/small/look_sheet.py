"""Picture of every look of the editor `small` on the built-in scene."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from torch import Tensor

THUMBNAIL_PIXELS = 128
COLUMN_COUNT = 9


def write_sheet(path: Path, force: bool) -> None:
    """Write a grid of named thumbnails: the unedited picture, then every look."""
    from gsedit.runs.environment import load_extra
    from gsedit.storage.atomic import atomic_path, check_writable
    from gsedit.words.looks import LOOKS

    check_writable(path, overwrite=force)
    drawing = load_extra("matplotlib.figure", "a picture of the looks")
    pictures = thumbnails()
    rows = -(-len(pictures) // COLUMN_COUNT)
    figure = drawing.Figure(figsize=(1.4 * COLUMN_COUNT, 1.6 * rows))
    axes = figure.subplots(rows, COLUMN_COUNT, squeeze=False)
    for axis in axes.flat:
        axis.axis("off")
    for axis, name, picture in zip(axes.flat, ("unedited", *LOOKS), pictures):
        axis.imshow(picture.numpy())
        axis.set_title(name, fontsize=9, pad=3)
    figure.tight_layout(pad=0.4)
    with atomic_path(path, overwrite=force) as temporary:
        figure.savefig(temporary, dpi=120, format="png")


def thumbnails() -> list[Tensor]:
    """Return pictures [h, w, 3] in [0, 1] of the built-in scene, unedited and with every look."""
    import torch

    from gsedit.diffusion.settings import SamplerSettings
    from gsedit.editors import EditBatch, make_editor
    from gsedit.synthetic import demo_scene, ring_cameras
    from gsedit.words.looks import LOOKS

    scene = demo_scene()
    image = scene.trace(ring_cameras(scene, 12, THUMBNAIL_PIXELS)[0]).image.float()
    editor, pictures = make_editor(), [image]
    for look in LOOKS.values():
        batch = EditBatch(image[None], image[None], look.wording)
        *_, last = editor.edit(batch, SamplerSettings(), torch.Generator().manual_seed(0))
        assert last.images is not None
        pictures.append(last.images[0])
    return pictures
