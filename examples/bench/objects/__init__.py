"""Benchmark of operations on objects: staged scenes with exact truth, baselines and measures."""
