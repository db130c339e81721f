"""Gaussians merged into fewer: pair by pair (decimation) or by groups (edits of large scenes)."""
