"""2D editors by name."""

from gsedit.editors.protocol import EditBatch, Editor, EditProgress
from gsedit.editors.registry import EDITORS, Listing, editor_names, list_editors, make_editor
from gsedit.editors.settle import settle

__all__ = [
    "EDITORS",
    "EditBatch",
    "EditProgress",
    "Editor",
    "Listing",
    "editor_names",
    "list_editors",
    "make_editor",
    "settle",
]
