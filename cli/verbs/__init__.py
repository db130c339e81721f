"""Verbs of the program, one in each file."""
