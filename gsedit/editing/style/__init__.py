"""Give a scene the style of a picture, from its own renders."""
