"""Error against run time of the rasteriser."""
