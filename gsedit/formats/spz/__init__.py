"""Niantic's .spz: its container and the meaning of its values."""
