"""Benchmarks: error against run time of the renderer and the sampler, edge cases, targets."""
