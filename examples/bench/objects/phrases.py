"""Phrases that name a thing of a staged scene, and some that name nothing.

Left and right are those of the first camera. Written before any reader of phrases was run on them.
"""

from __future__ import annotations

NAMED: dict[str, tuple[tuple[str, str], ...]] = {
    "pedestal": (
        ("the orange one", "orange statue"),
        ("the orange statue", "orange statue"),
        ("the thing on the gray block", "orange statue"),
        ("the gray block", "gray pedestal"),
        ("the highest object", "orange statue"),
        ("the ground", "tiled floor"),
    ),
    "meadow": (
        ("the red ball", "red ball"),
        ("the blue one", "blue post"),
        ("the largest object", "red ball"),
        ("the object on the right", "blue post"),
        ("the left object", "red ball"),
        ("the thing left of the blue one", "red ball"),
        ("the grass", "grass"),
    ),
    "wall": (
        ("the blue box", "blue crate"),
        ("the object on the ground", "blue crate"),
        ("the blue thing in front of the wall", "blue crate"),
        ("the ground", "wooden floor"),
        ("the wall", "brick wall"),
    ),
    "corner": (
        ("the green ring", "green ring"),
        ("the yellow one", "yellow box"),
        ("the small yellow box", "yellow box"),
        ("the floor", "checkered floor"),
        ("the biggest object", "green ring"),
    ),
    "table": (
        ("the small red ball", "small red ball"),
        ("the large red ball", "large red ball"),
        ("the biggest red one", "large red ball"),
        ("the smallest red thing", "small red ball"),
        ("the blue ball", "blue ball"),
        ("the green box", "green box"),
        ("the yellow one", "yellow ball"),
        ("the object on top of the green one", "yellow ball"),
        ("the white one", "white pillar"),
        ("the purple thing", "purple disc"),
        ("the rightmost object", "white pillar"),
        ("the thing left of the blue ball", "purple disc"),
        ("the red ball on the right", "small red ball"),
    ),
    "glimpse": (
        ("the orange one", "orange bollard"),
        ("the object on the left", "gray stone"),
        ("the gray ball", "gray stone"),
        ("the ground", "paving"),
    ),
}
"""Stage -> (phrase, name of the thing): 40 in all."""

REFUSED = (
    ("pedestal", "the giraffe"),
    ("meadow", "the green ball"),
    ("wall", "the second violin"),
    ("corner", "the purple one"),
    ("table", "the orange pyramid"),
    ("glimpse", "what my aunt likes"),
)
"""(stage, phrase) pairs that name nothing."""
