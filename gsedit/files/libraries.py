"""Libraries that leave traces in the process when they are loaded."""

from __future__ import annotations

import signal
import threading
from typing import Any


def import_pycolmap() -> Any:
    """The module pycolmap. Its logging library (glog) takes SIGTERM over and ends the process with
    a stack trace: the handler that was there before is put back, so that work can keep what is
    done."""
    before = signal.getsignal(signal.SIGTERM)
    import pycolmap

    if before is not None and threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGTERM, before)
    return pycolmap
