"""Error against run time of the sampler: its solvers, consensus and cost."""
