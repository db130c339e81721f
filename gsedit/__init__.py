"""Edit captured 3D scenes (3D Gaussian splats) from a sentence, on a machine without a GPU."""
