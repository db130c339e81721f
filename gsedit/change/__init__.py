"""Changes on the Gaussians: materials, light, weather, objects."""
