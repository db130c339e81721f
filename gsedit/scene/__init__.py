"""A scene as numbers: its table, similarities, order, neighbors and merging."""
