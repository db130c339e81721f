"""Error against run time of the renderer, its edge cases and its performance targets."""
