"""Light: a scene lit again by sun, sky, lamps and fog, on the Gaussians themselves."""
