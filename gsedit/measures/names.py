"""What each metric is called, and which way it is better. Needs no torch."""

from __future__ import annotations

from typing import Literal, NamedTuple

Better = Literal["higher", "lower", "neither"]


class Metric(NamedTuple):
    """A metric for a person."""

    label: str
    better: Better
    decimals: int


METRICS: dict[str, Metric] = {
    "psnr_to_targets": Metric("PSNR to the {targets}, dB", "higher", 2),
    "ssim_to_targets": Metric("SSIM to the {targets}", "higher", 4),
    "perceptual_to_targets": Metric("perceptual distance to the {targets}", "lower", 4),
    "psnr_to_unedited": Metric("PSNR to the unedited scene, dB", "neither", 2),
    "ssim_to_unedited": Metric("SSIM to the unedited scene", "neither", 4),
    "perceptual_to_unedited": Metric("perceptual distance to the unedited", "neither", 4),
    "strength": Metric("strength: RMSE to the unedited", "neither", 4),
    "leakage": Metric("leakage: RMSE outside the region", "lower", 4),
    "kept": Metric("kept outside the region: PSNR, dB", "higher", 2),
    "clip_similarity": Metric("CLIP similarity to the text", "higher", 4),
    "clip_direction": Metric("CLIP direction, signed", "higher", 4),
    "clip_consistency": Metric("CLIP direction consistency", "higher", 4),
    "clip_preservation": Metric("CLIP similarity to the unedited", "neither", 4),
    "conse_similarity": Metric("ConSE similarity to the text", "higher", 4),
    "conse_rise": Metric("ConSE: rise over the unedited", "higher", 4),
}
"""In the order in which they are shown. `{targets}` is what the targets are: pictures, photos.
ConSE is the second opinion of gsedit.measures.conse; it is not CLIP."""
WARP: dict[tuple[str, str], str] = {
    ("targets", "short"): "warp_targets_short",
    ("targets", "long"): "warp_targets_long",
    ("renders", "short"): "warp_renders_short",
    ("renders", "long"): "warp_renders_long",
}
"""Names of the rows of warp errors, by pictures and range."""
COST = ("seconds", "evaluations")
"""What the edit took: wall clock, and evaluations of the 2D editor's network."""
