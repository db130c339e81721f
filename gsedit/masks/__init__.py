"""Mask providers: programs and networks that find what a phrase names in pictures."""
