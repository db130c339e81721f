"""How a scene looks, changed from its own renders: the style of a picture, the subject alone."""
