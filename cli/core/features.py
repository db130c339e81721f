"""Features under the Gram loss, by the name given on the command line."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gsedit.errors import UsageError

if TYPE_CHECKING:
    from gsedit.measures.features import FeatureExtractor


def load_features(name: str) -> FeatureExtractor:
    """Load the features under the Gram loss. Raises UsageError, InputError."""
    if name == "filters":
        from gsedit.measures.features import FilterBank

        return FilterBank()
    if name == "vgg":
        from gsedit.measures.perceptual import vgg_features

        return vgg_features()
    raise UsageError(f"--features must be filters or vgg, not {name!r}")
