"""Scenes whose edits are known exactly, and what measures operations on objects by them."""
