"""`python -m gsedit_cli.core.warm`: load everything, then run the one command that stdin names."""

from __future__ import annotations

import json
import os
import signal
import sys
from importlib import import_module
from threading import Thread

LOADED = ("torch", "gsedit.editing.measure", "gsedit_cli.verbs.edit", "gsedit_cli.main")
"""Modules that edits need, which take most of the time of a short one."""


def end_with_stdin() -> None:
    """End this process as Ctrl-C does once nobody holds its stdin: the page was killed."""
    sys.stdin.readline()
    os.kill(os.getpid(), signal.SIGTERM)


def main() -> None:
    """Run the command of one line of stdin, a JSON list of arguments; none where stdin ends."""
    for name in LOADED:
        import_module(name)
    line = sys.stdin.readline()
    if not line.strip():
        return
    sys.argv = ["gsedit", *json.loads(line)]
    Thread(target=end_with_stdin, daemon=True).start()
    from ..main import main as run

    run()


if __name__ == "__main__":
    main()
