"""Measurements of a machine and its renderer, and synthetic scenes whose truth is known."""
