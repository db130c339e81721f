"""A baseline of the paper as a strategy: the score distillation of Vox-E."""
