"""Losses, the features under them, and metrics."""
