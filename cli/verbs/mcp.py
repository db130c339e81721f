"""`gsedit mcp`: verbs as tools of the Model Context Protocol."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

from gsedit.errors import UsageError

from ..core.command import argument


def mcp(
    folders: Annotated[
        list[Path], argument("FOLDER...", "Folders whose files may be read and written.")
    ],
) -> None:
    """Let a program that speaks MCP look at, edit and convert scenes.

    gsedit mcp scenes/

    The tools info, edit, make, convert and render are offered on stdin and stdout until stdin
    closes. No file outside of the folders is read or written, also not through links.
    """
    for folder in folders:
        if not folder.is_dir():
            raise UsageError(f"{folder} is no folder: name one that exists")
    from gsedit.mcp_server import serve

    serve((sys.executable, "-m", "gsedit_cli"), folders)
