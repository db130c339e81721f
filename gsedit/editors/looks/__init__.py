"""Looks: what the words of an instruction do to colours, in three variants each.

colour_maps holds the formulas, table the looks, recipe what an instruction names.
"""
