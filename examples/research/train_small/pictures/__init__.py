"""Pictures of random things outdoors and indoors, ray-cast with exact depth, normals and masks.

A picture is one subject (a pile of balls, boxes and drums) on a textured ground, among props,
before backdrops (trees, walls, hills) and a sky.

World: +z up, the ground at z = 0, the subject about 1 in size. A ray is origin + t * direction with
directions of unit depth: t is depth along the view. Letters of all shapes: `m` rays, or the points
where they end; `k` solids; `s` texels a side of a texture; `h w` pixels. Colors are linear rgb
until the camera response.
"""

from research.train_small.pictures.colors import color
from research.train_small.pictures.procedural import procedural
from research.train_small.pictures.random_stream import RandomStream
from research.train_small.pictures.solids import BALL, BOX, DRUM, Solid
from research.train_small.pictures.subjects import SUBJECTS
from research.train_small.pictures.vectors import Point

__all__ = [
    "BALL",
    "BOX",
    "DRUM",
    "SUBJECTS",
    "Point",
    "RandomStream",
    "Solid",
    "color",
    "procedural",
]
