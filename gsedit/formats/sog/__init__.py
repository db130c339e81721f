"""PlayCanvas' .sog: its container, its pictures and their encoding."""
