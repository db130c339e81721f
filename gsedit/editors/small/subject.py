"""Subject of an instruction: its probability at each pixel, and whether it alone is meant.

`v` views of `h w` pixels.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.datasets.padding import pad_to_multiple
from gsedit.editors.small.network import (
    CELL_PIXELS,
    EncodedImage,
    SmallNetwork,
    from_cells,
    to_cells,
)
from gsedit.editors.small.text import tokenise

SIGMA = 37.0
"""Noise level at which sampling starts: the first prediction of an edit is whole, and needs one
pass."""
LOOKED_AT = 4
"""Views on which the reach of an instruction is tried; all of a batch if it is smaller."""
SURE = 0.9
"""Probability of the subject from which a pixel counts as its; surroundings are below 1 - SURE."""
LOG_ODDS = 6.0
"""Log-odds of the subject where it is told, about those of the network where it is sure."""
WHOLE_SCENE_RATIO = 0.25
"""RMS change of the surroundings, relative to the subject's, from which an instruction is about the
whole scene. On renders of the bear and of the demo scene, it is 0.01 to 0.16 for the looks of the
subject and 0.38 to 2.97 for the others (three held-out wordings each); on three other scenes 0.03
to 0.07, and 0.48 to 3.60."""


@torch.no_grad()
def subject_map(
    network: SmallNetwork, originals: Float[Tensor, "v h w 3"]
) -> Float[Tensor, "v h w"]:
    """The probability that a pixel shows the main subject, whatever the instruction is."""
    height, width = originals.shape[1:3]
    padded = pad_to_multiple(originals, CELL_PIXELS, "mirror")
    encoded = [_encode(network, image[None]) for image in padded]
    return _subject(encoded)[:, :height, :width]


def subject_probability(
    network: SmallNetwork, prompt: str, originals: Float[Tensor, "v h w 3"]
) -> Float[Tensor, "v h w"] | None:
    """The probability that a pixel shows the main subject, or None where the instruction is about
    the whole picture, not the subject alone.
    """
    height, width = originals.shape[1:3]
    originals = pad_to_multiple(originals, CELL_PIXELS, "mirror")
    encoded = [_encode(network, image[None]) for image in originals]
    subject = _subject(encoded)
    chosen = torch.linspace(0, len(originals) - 1, min(LOOKED_AT, len(originals))).round().long()
    text = network.text_encoder(tokenise([prompt]))
    change = torch.cat(
        [_first_change(network, originals[i][None], encoded[i], text) for i in chosen.tolist()]
    )
    is_whole = reach(change, subject[chosen]) > WHOLE_SCENE_RATIO
    return None if is_whole else subject[:, :height, :width]


def _subject(encoded: Sequence[EncodedImage]) -> Float[Tensor, "v h w"]:
    return torch.cat([each.geometry[:, 0].sigmoid() for each in encoded])


def with_subject(encoded: EncodedImage, subject: Float[Tensor, "v h w"]) -> EncodedImage:
    """Features of these views with the subject replaced by a given probability."""
    log_odds = torch.logit(subject.clamp(0, 1), eps=1e-6).clamp(-LOG_ODDS, LOG_ODDS)
    told = log_odds[:, None].to(encoded.pixels)
    return encoded._replace(pixels=torch.cat((told, encoded.pixels[:, 1:]), 1))


def reach(change: Float[Tensor, "v h w"], subject: Float[Tensor, "v h w"]) -> float:
    """RMS change of the surroundings relative to that of the subject; `change` is squared."""
    most, least = subject.flatten().quantile(torch.tensor([0.95, 0.25])).tolist()
    inside = change[subject >= min(SURE, most)]  # the likeliest, where the network is never sure
    outside = change[subject <= max(1 - SURE, least)]
    return float((outside.mean() / inside.mean().clamp_min(1e-12)).sqrt())


def _encode(network: SmallNetwork, images: Float[Tensor, "v h w 3"]) -> EncodedImage:
    cells = to_cells(images.float())
    return network.encode_image(cells, cells.new_ones(len(cells)))


def _first_change(
    network: SmallNetwork,
    images: Float[Tensor, "v h w 3"],
    encoded: EncodedImage,
    text: Float[Tensor, "1 d"],
) -> Float[Tensor, "v h w"]:
    """Squared change of each pixel in the first prediction of the edit, mean over channels."""
    cells = to_cells(images.float())
    ones = cells.new_ones(len(cells))
    x = cells / (1 + SIGMA**2) ** 0.5  # the noise at its mean: the result depends on no draw
    predicted = network(x, SIGMA * ones, cells, ones, encoded, text.expand(len(cells), -1))
    return (from_cells(predicted) - images).square().mean(-1)
