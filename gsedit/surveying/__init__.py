"""Lengths, heights, areas and volumes of what a scene shows, each with its uncertainty."""
