"""The editor `small` told where its subject is.

`v` views of `h w` pixels.
"""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.editors.small.network import EncodedImage

LOG_ODDS = 6.0
"""Log-odds of the subject where it is told, about those of the network where it is sure."""


def with_subject(encoded: EncodedImage, subject: Float[Tensor, "v h w"]) -> EncodedImage:
    """Features of these views with the subject replaced by a given probability."""
    log_odds = torch.logit(subject.clamp(0, 1), eps=1e-6).clamp(-LOG_ODDS, LOG_ODDS)
    told = log_odds[:, None].to(encoded.pixels)
    return encoded._replace(pixels=torch.cat((told, encoded.pixels[:, 1:]), 1))
