"""Gaussians merged into fewer: pair by pair (decimation) or by cells (edits of large scenes)."""
