"""`gsedit looks`: what the editor `small` knows, and what it takes a sentence for."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .console import print_message, print_result
from .options import Common, Force

if TYPE_CHECKING:
    from torch import Tensor

Sentence = Annotated[
    str | None,
    typer.Argument(
        metavar="SENTENCE",
        show_default=False,
        help="An instruction, to see which looks it is understood as.",
    ),
]
Sheet = Annotated[
    Path | None,
    typer.Option(
        "--output",
        "-o",
        metavar="PATH",
        show_default=False,
        help="Picture to write: every look on the built-in scene (about a minute).",
    ),
]

THUMBNAIL = 128
"""Pixels."""
COLUMNS = 9


def looks(
    sentence: Sentence = None,
    out: Sheet = None,
    force: Force = False,
    *,
    common: Common,
) -> None:
    """List the looks that the editor small knows, or tell which of them a sentence asks for.

    gsedit looks "as if it had spent a century under the sea" --json
    """
    common.apply()
    if sentence is not None:
        print_understanding(sentence, as_json=common.json)
    if out is not None:
        write_sheet(out, force)
        print_result({"sheet": out}, str(out), as_json=common.json)
    elif sentence is None:
        print_list(as_json=common.json)


def print_list(*, as_json: bool) -> None:
    """Every look, those of the subject first."""
    from gsedit.words import LOOKS

    for look in LOOKS.values():
        record = {"name": look.name, "scope": look.scope, "wording": look.wording}
        print_result(record, f"{look.name:<16} {look.scope:<8} {look.wording}", as_json=as_json)
    if not as_json:
        print_message(
            "ask for one in your own words, or for one of the subject and one of the scene; "
            'see what a sentence is taken for: gsedit looks "SENTENCE"; see them: gsedit looks '
            "-o looks.png"
        )


def print_understanding(sentence: str, *, as_json: bool) -> None:
    """The looks that a sentence is understood as. Raises UsageError for an empty one."""
    from gsedit.errors import UsageError
    from gsedit.words import understand

    if not sentence.strip():
        raise UsageError("the sentence is empty: say what should change, as in 'make it snow'")
    understood = understand(sentence)
    record = {
        "looks": [{"name": each.name, "score": each.score} for each in understood.looks],
        "known": understood.known,
    }
    scores = ", ".join(f"{each.name} {each.score:.2f}" for each in understood.looks)
    text = scores if understood.known else f"none of the known looks; the nearest: {scores}"
    print_result(record, text, as_json=as_json)


def write_sheet(path: Path, force: bool) -> None:
    """A grid of thumbnails, each with its name: the unedited picture, then every look."""
    import matplotlib.pyplot as plt

    from gsedit.files.atomic import atomic_path, check_writable
    from gsedit.words import LOOKS

    check_writable(path, overwrite=force)
    pictures = thumbnails()
    rows = -(-len(pictures) // COLUMNS)
    figure, axes = plt.subplots(rows, COLUMNS, figsize=(1.4 * COLUMNS, 1.6 * rows), squeeze=False)
    for axis in axes.flat:
        axis.axis("off")
    for axis, name, picture in zip(axes.flat, ("unedited", *LOOKS), pictures):
        axis.imshow(picture.numpy())
        axis.set_title(name, fontsize=9, pad=3)
    figure.tight_layout(pad=0.4)
    with atomic_path(path, overwrite=force) as temporary:
        figure.savefig(temporary, dpi=120, format="png")
    plt.close(figure)


def thumbnails() -> list[Tensor]:
    """The built-in scene, unedited and with every look; [h, w, 3] in [0, 1]."""
    import torch

    from gsedit.diffusion import SamplerSettings
    from gsedit.editors import EditBatch, make_editor
    from gsedit.synthetic import demo_scene, ring_cameras
    from gsedit.words import LOOKS

    scene = demo_scene()
    image = scene.trace(ring_cameras(scene, 12, THUMBNAIL)[0]).image.float()
    editor, pictures = make_editor(), [image]
    for look in LOOKS.values():
        batch = EditBatch(image[None], image[None], look.wording)
        *_, last = editor.edit(batch, SamplerSettings(), torch.Generator().manual_seed(0))
        assert last.images is not None
        pictures.append(last.images[0])
    return pictures
