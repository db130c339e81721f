"""Seconds, memory and error of an edit against the number of Gaussians."""
