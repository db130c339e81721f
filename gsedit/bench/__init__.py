"""Measurements of the renderer: error against run time, the promised bars, the museum's table."""
