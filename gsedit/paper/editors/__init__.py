"""2D editors by name; each name here is imported when it is first used."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rasterizer.lazy import make_lazy

if TYPE_CHECKING:
    from gsedit.paper.editors.plugins import Listing
    from gsedit.paper.editors.protocol import (
        Capabilities,
        Denoiser,
        EditBatch,
        Editor,
        EditProgress,
    )
    from gsedit.paper.editors.registry import list_editors, make_editor, make_masks

make_lazy(__name__)
