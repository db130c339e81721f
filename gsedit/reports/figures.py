"""Error and loss against run time, as curves."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Literal

from gsedit.reports.events import Event


def curves(
    events: Iterable[Event], field: Literal["error", "loss"] = "error"
) -> dict[str, list[tuple[float, float]]]:
    """(seconds, value) of every event that measured the field, by stage, in order."""
    measured: dict[str, list[tuple[float, float]]] = {}
    for event in events:
        value = getattr(event, field)
        if value is not None and math.isfinite(value):
            measured.setdefault(event.stage, []).append((event.seconds, value))
    return measured
