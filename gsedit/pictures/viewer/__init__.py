"""Scenes as point clouds of pyvista and Open3D, and a preview of their centers."""
