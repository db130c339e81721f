"""Sweep of the renderer's error against run time, beside other renderers."""
