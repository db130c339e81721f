"""Move, scale, turn and copy an object, and insert one of another scene: it stands, and is lit."""
