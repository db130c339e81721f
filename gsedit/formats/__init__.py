"""Scenes in files, one format a module."""
