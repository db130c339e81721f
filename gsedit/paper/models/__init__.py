"""2D editing models in diffusers' layout: found, inspected, loaded, and run as denoisers."""
