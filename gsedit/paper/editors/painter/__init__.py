"""Painting styles: published networks that draw."""
