"""Regions: the Gaussians that an edit may change, from predictions, masks, shapes or flags."""
