"""Speed and errors of the renderer, and its edge cases."""
