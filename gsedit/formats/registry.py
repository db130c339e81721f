"""Scene formats: their suffixes, the modules that read them, what each can hold. Loads no numpy."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Format:
    """One kind of scene file."""

    suffix: str
    """Ending of the file name, in lower case."""
    module: str
    """In gsedit.formats; imported when it is used."""
    writes: bool = True
    max_degree: int = 3
    """Highest SH degree that the format can hold, where it is written."""
    keeps: frozenset[str] = frozenset()
    """Fields of `SceneHeader` that the format can hold beside the splats."""


MESHES = (".obj", ".stl", ".off")
USD = (".usda", ".usdc", ".usd", ".usdz")
INDEX = "meta.json"
"""Name of the file that stands for its folder: a SOG that is no zip."""
NOTES = frozenset(("comments", "antialiased"))
"""Fields that files with free text keep beside the splats."""
FORMATS = (
    Format(".ply", "ply.inria", max_degree=4, keeps=frozenset(("extra", "elements", "comments"))),
    Format(".compressed.ply", "ply.compressed"),
    Format(".spz", "spz", max_degree=4, keeps=frozenset(("antialiased",))),
    Format(".sog", "sog.file", keeps=frozenset(("antialiased",))),
    Format(INDEX, "sog.file", writes=False),
    Format(".splat", "splat", max_degree=0),
    Format(".glb", "gltf.file", keeps=NOTES),
    *(Format(suffix, "usd.file", max_degree=4, keeps=NOTES) for suffix in USD),
    *(Format(suffix, "mesh", writes=False) for suffix in MESHES),
)
READABLE = tuple(format.suffix for format in FORMATS)
WRITABLE = tuple(format.suffix for format in FORMATS if format.writes)
