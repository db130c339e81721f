"""Gaussians from pictures: the fit to photos, and the update to edited views."""
