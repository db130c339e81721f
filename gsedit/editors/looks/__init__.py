"""Looks: what the words of an instruction do to colors, in three variants each.

color_maps holds the formulas, table the looks, recipe what an instruction names.
"""
