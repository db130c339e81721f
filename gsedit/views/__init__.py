"""Cameras and pictures: datasets, framing, and which views an edit needs."""
