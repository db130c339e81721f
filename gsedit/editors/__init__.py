"""2D editors by name; each name here is imported when it is first used."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rasterizer.lazy import make_lazy

if TYPE_CHECKING:
    from gsedit.editor_protocol import Capabilities, Denoiser, EditBatch, Editor, EditProgress
    from gsedit.editors.registry import EDITORS, Listing, editor_names, list_editors, make_editor

make_lazy(__name__)
