"""Materials on Gaussians: what they are made of, and how they look in the light of their scene."""
