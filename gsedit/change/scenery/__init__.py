"""Seasons and weather on the Gaussians themselves: snow, rain, autumn and their like."""
