"""Work that takes long: its events, journal, clock, saved state and processes (ranks)."""
