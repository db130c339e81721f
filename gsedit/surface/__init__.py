"""Surfaces of a captured scene and the light around them: normals, surroundings, occlusion."""
