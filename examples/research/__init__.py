"""Experiments behind the numbers in docs/; nothing that a user runs."""
