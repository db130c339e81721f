"""Baselines of the paper as strategies: Vox-E's score distillation, NeRF-Art's losses."""
