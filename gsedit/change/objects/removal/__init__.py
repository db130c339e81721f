"""Removing an object: its strays and its shadow, and what is put where nobody saw."""
