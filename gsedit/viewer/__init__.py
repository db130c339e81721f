"""Scenes and results as something to look at."""
