"""Cameras: orbits, paths, and viewpoints found for a scene without any."""
