"""Bending by handles: what is between them follows as rigidly as possible."""
