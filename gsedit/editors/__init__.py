"""2D editors by name."""

from __future__ import annotations

from pathlib import Path

from gsedit.editors.protocol import EditBatch, Editor, EditProgress
from gsedit.errors import UsageError

__all__ = ["EDITORS", "EditBatch", "EditProgress", "Editor", "make_editor"]

EDITORS = ("closed-form", "pix2pix")
PIX2PIX = "timbrooks/instruct-pix2pix"  # the authors' own weights on the hub


def make_editor(
    name: str = "closed-form",
    *,
    model: str | Path | None = None,
    weights_dir: str | Path | None = None,
) -> Editor:
    """The editor of that name; `model` and `weights_dir` are for pix2pix (see load_pix2pix).

    Raises UsageError for an unknown name or a model that the editor has no use for.
    """
    from gsedit.editors.sampling import DiffusionEditor

    if name == "closed-form":
        if model is not None or weights_dir is not None:
            raise UsageError("the closed-form editor takes no weights: add --editor pix2pix")
        from gsedit.editors.closed_form import ClosedForm

        return DiffusionEditor(ClosedForm())
    if name == "pix2pix":
        from gsedit.editors.pix2pix import load_pix2pix

        return DiffusionEditor(load_pix2pix(model or PIX2PIX, weights_dir=weights_dir))
    raise UsageError(f"there is no editor {name!r}: choose {' or '.join(EDITORS)}")
