"""Where an edit belongs: the Gaussians it may change, from predictions, masks, shapes, flags."""
