"""Pictures and tables for people: sheets, maps, curves, animations, viewers."""
