"""Pictures and tables for people: sheets, maps, curves, animations, viewers."""

from typing import Literal, get_args

MapName = Literal["color", "depth", "normals", "alpha"]
"""Maps of a view, see `gsedit.pictures.maps`."""
MAPS: tuple[MapName, ...] = get_args(MapName)
Format = Literal["png", "exr", "npy"]
"""Formats of a view's maps, see `gsedit.pictures.rendered_views`."""
