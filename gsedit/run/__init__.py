"""Long work: events, checkpoints, ranks; files written whole and read with care."""
