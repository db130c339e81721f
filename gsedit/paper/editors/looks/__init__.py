"""Looks: what the words of an instruction do to colors, in three variants each."""
