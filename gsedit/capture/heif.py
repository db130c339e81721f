"""HEIC photos, which iPhones take, made readable to Pillow."""

from __future__ import annotations

from functools import cache


@cache
def register_heif() -> bool:
    """Let Pillow open .heic files in this process; whether it can. Their pixels and sizes come as
    they are shown, their EXIF orientation as 1; the info `original_orientation` keeps it."""
    try:
        import pi_heif
    except (ImportError, OSError):
        return False
    pi_heif.register_heif_opener()
    return True
