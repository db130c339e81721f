"""Stiff and extreme inputs of the refinement, the fitting of a scene to edited views."""
