"""Datasets of posed photos, the views made of them, and the lists and files of views."""
