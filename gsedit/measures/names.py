"""The names of all metrics, and which way each is better. Needs no torch."""

from __future__ import annotations

from typing import Literal, NamedTuple

Better = Literal["higher", "lower", "neither"]


class Metric(NamedTuple):
    """The label of a metric, and how its values are read."""

    label: str
    better: Better
    decimals: int


METRICS: dict[str, Metric] = {
    "psnr_to_targets": Metric("PSNR to the {targets}, dB", "higher", 2),
    "ssim_to_targets": Metric("SSIM to the {targets}", "higher", 4),
    "perceptual_to_targets": Metric("perceptual distance to the {targets}", "lower", 4),
    "psnr_to_edits_alone": Metric("PSNR to edits made alone, dB", "higher", 2),
    "ssim_to_edits_alone": Metric("SSIM to edits made alone", "higher", 4),
    "perceptual_to_edits_alone": Metric("perceptual distance to edits made alone", "lower", 4),
    "psnr_to_unedited": Metric("PSNR to the unedited scene, dB", "neither", 2),
    "ssim_to_unedited": Metric("SSIM to the unedited scene", "neither", 4),
    "perceptual_to_unedited": Metric("perceptual distance to the unedited", "neither", 4),
    "rmse_to_unedited": Metric("RMSE to the unedited scene", "neither", 4),
    "rmse_outside_region": Metric("RMSE outside the region", "lower", 4),
    "psnr_outside_region": Metric("PSNR outside the region, dB", "higher", 2),
    "rmse_outside_masks": Metric("RMSE outside the given masks", "lower", 4),
    "psnr_outside_masks": Metric("PSNR outside the given masks, dB", "higher", 2),
}
"""Metrics in the order in which they are shown. `{targets}` stands for the kind of targets:
pictures, photos."""
GROUND_TRUTH = (
    "psnr_to_ground_truth",
    "ssim_to_ground_truth",
    "perceptual_to_ground_truth",
)
"""Metrics of an edit by an editor whose true edit is known; others have none to measure."""
WARP: dict[tuple[str, str], str] = {
    ("targets", "short"): "warp_targets_short",
    ("targets", "long"): "warp_targets_long",
    ("renders", "short"): "warp_renders_short",
    ("renders", "long"): "warp_renders_long",
}
"""Names of the rows of warp errors, by pictures and range."""
POINTS: dict[Literal["targets", "renders"], str] = {
    "targets": "points_targets",
    "renders": "points_renders",
}
"""Names of the rows of differences at matched points, by pictures."""
COST = ("seconds", "evaluations")
"""The cost of an edit: wall clock, and evaluations of the 2D editor's network."""
