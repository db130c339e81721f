"""Long work: events, checkpoints; files written whole and read with care."""
