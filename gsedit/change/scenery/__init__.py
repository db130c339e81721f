"""Seasons, weather and drawings by name: snow, rain, autumn and their like, on Gaussians."""
