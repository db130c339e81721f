"""Error against run time of the sampler."""
