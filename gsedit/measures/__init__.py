"""Losses, the features under them, metrics, and decibels."""
