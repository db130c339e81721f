"""Routes that change Gaussians directly, without a 2D editor."""
