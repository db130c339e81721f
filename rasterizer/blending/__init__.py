"""Blending 2D Gaussians into pictures: one file a backend."""
