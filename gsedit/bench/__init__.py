"""Measurements of a machine: the renderer's speed with its errors, and its edge cases."""
