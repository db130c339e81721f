"""2D editors by name."""

from gsedit.consistency.harmonise import harmonise
from gsedit.editors.protocol import EditBatch, Editor, EditProgress
from gsedit.editors.registry import EDITORS, Listing, editor_names, list_editors, make_editor

__all__ = [
    "EDITORS",
    "EditBatch",
    "EditProgress",
    "Editor",
    "Listing",
    "editor_names",
    "harmonise",
    "list_editors",
    "make_editor",
]
