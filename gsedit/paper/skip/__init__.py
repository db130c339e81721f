"""Decisions to skip work in an edit of a given scene, each with its bound: pure functions."""
