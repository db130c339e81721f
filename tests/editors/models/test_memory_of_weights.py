"""Weights that do not fit into memory are refused before they are read."""

from __future__ import annotations

import pytest

from gsedit.errors import UsageError
from gsedit.models import parts
from gsedit.models.loading import load_model

pytestmark = pytest.mark.usefixtures("offline")


def test_weights_that_would_be_converted_must_fit(folder, monkeypatch):
    monkeypatch.setattr(parts, "free_bytes", lambda: 1000)
    with pytest.raises(UsageError, match=r"GB of memory in bfloat16, and 0\.0 GB are free"):
        load_model(folder, precision="bfloat16")
    parts.Parts.of(folder).check_memory()  # as stored: mapped from the disk
    monkeypatch.setattr(parts, "free_bytes", lambda: 10**12)
    parts.Parts.of(folder, "bfloat16").check_memory()
