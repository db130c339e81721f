"""How much memory a packed file may ask for: never far more than its own bytes explain."""

from __future__ import annotations

from pathlib import Path

from gsedit.errors import InputError

_ALWAYS = 16 << 20
"""Bytes that any file may unpack to."""
_EXPANSION = 1032
"""Of deflate at most. Formats that could expand more are held to the same: no scene does."""


def check_expansion(path: Path, packed: int, unpacked: int) -> None:
    """Raise InputError where `packed` bytes of the file announce too many `unpacked` ones."""
    if unpacked > max(_ALWAYS, _EXPANSION * packed):
        raise InputError(
            f"{path} announces {unpacked / 1e9:.3g} GB of Gaussians in {packed / 1e6:.3g} MB: "
            "it is damaged or made to fill memory, export it again"
        )
