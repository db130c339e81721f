"""Scenes in the browser, and as point clouds of pyvista and Open3D."""
