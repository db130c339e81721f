"""Materials: the names that are read, and their base colors."""

from __future__ import annotations

from gsedit.words import lexicon

MATERIALS = lexicon.materials()
"""Base colors, "#rrggbb", by name."""
MATERIAL_NAMES = {
    phrase: entry.value
    for phrase, entry in lexicon.entries().items()
    if entry.kind == "material" or phrase in MATERIALS
}
"""Names of materials by the phrases that are read as them."""
