"""The training loss of the small network. `n` pictures, `b` prompts and targets, cells `c y x`."""

from __future__ import annotations

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from gsedit.editors.small.denoiser import sigma_at
from gsedit.editors.small.network import PRIOR_STD, EncodedImage, SmallNetwork, to_cells
from gsedit.editors.small.text import Tokens, tokenise
from research.train_small.batches import TrainingBatch
from research.train_small.settings import TrainSettings

MAX_WEIGHT = 10.0
"""Largest weight of a sample: at low noise x_t holds nearly all of the target."""
T_MIN, T_MAX = 0.003, 0.993
"""Range of the times, as shares of the schedule."""
HIGH_NOISE_T, HIGH_NOISE_SHARE = 0.8, 0.6
"""This share of the samples is drawn from t > HIGH_NOISE_T, where the noise hides the edit."""
UNEDITED_T = 0.9
"""Above this t half of the samples start from the noised unedited picture; see noisy_targets."""


def training_loss(
    network: SmallNetwork, batch: TrainingBatch, generator: torch.Generator, s: TrainSettings
) -> Float[Tensor, ""]:
    """Weighted squared error of x0 at random noise levels, plus the image encoder's geometry loss.

    Pictures and prompts are dropped at random, as classifier-free guidance needs it. All chance is
    drawn on the CPU, so that a seed means the same on every device; the network's computes.
    """
    device = next(network.parameters()).device
    count, edits = len(batch.images), len(batch.prompts) // len(batch.images)
    cells, targets = to_cells(batch.images), to_cells(batch.targets)
    images = cells.repeat_interleave(edits, 0)
    sigma, x = noisy_targets(targets, images, generator)
    image_dropped = torch.rand(count, generator=generator) < 2 * s.condition_dropout
    no_image = image_dropped.repeat_interleave(edits)
    u = torch.rand(len(targets), generator=generator)
    no_text = u < torch.where(no_image, 0.5, s.condition_dropout)
    prompts = ["" if drop else prompt for drop, prompt in zip(no_text.tolist(), batch.prompts)]
    fast = s.precision != torch.float32
    tokens = Tokens(*(part.to(device) for part in tokenise(prompts)))
    cells, targets, images, sigma, x, image_dropped, no_image = (
        each.to(device) for each in (cells, targets, images, sigma, x, image_dropped, no_image)
    )
    with torch.autocast(device.type, dtype=s.precision, enabled=fast):
        encoded = network.encode_image(cells, (~image_dropped).float())
        repeated = EncodedImage(*(part.repeat_interleave(edits, 0) for part in encoded))
        text = network.text_encoder(tokens)
        x0 = network(x, sigma, images, (~no_image).float(), repeated, text).float()
    weight = ((PRIOR_STD**2 + sigma**2) / sigma**2).clamp_max(MAX_WEIGHT)
    error = weight * (x0 - targets).square().mean((1, 2, 3))
    geometry = (~image_dropped * _geometry_loss(encoded, batch)).mean()
    return error.mean() + s.geometry_weight * geometry


def _geometry_loss(encoded: EncodedImage, batch: TrainingBatch) -> Float[Tensor, " n"]:
    """Cross entropy of the subject's mask plus squared errors of inverse depth and height."""
    subject, *rest = encoded.geometry.float().unbind(1)
    true_subject, *true_rest = batch.geometry.to(subject).unbind(-1)
    entropy = F.binary_cross_entropy_with_logits(subject, true_subject, reduction="none")
    squares = torch.stack(rest).sub(torch.stack(true_rest)).square().sum(0)
    return (entropy + squares).mean((1, 2))


def noisy_targets(
    targets: Float[Tensor, "b c y x"],
    unedited: Float[Tensor, "b c y x"],
    generator: torch.Generator,
) -> tuple[Float[Tensor, " b"], Float[Tensor, "b c y x"]]:
    """(sigma, x_t) at random times of the schedule, more of them at high noise.

    Sampling starts from a noised render of the *unedited* scene. A network that was trained on
    noised targets alone takes the mean color that is visible through the noise for the target's,
    and edits too little: so above UNEDITED_T half of the samples start from the unedited picture.
    """
    u, v = torch.rand(2, len(targets), generator=generator)
    lowest = torch.where(v < HIGH_NOISE_SHARE, HIGH_NOISE_T, T_MIN)
    t = lowest + (T_MAX - lowest) * u
    sigma = sigma_at(t)
    starts = (t > UNEDITED_T) & (torch.rand(len(targets), generator=generator) < 0.5)
    clean = torch.where(starts[:, None, None, None], unedited, targets)
    a = (1 + sigma**2).rsqrt()[:, None, None, None]
    noise = torch.randn(targets.shape, generator=generator)
    return sigma, a * (clean + sigma[:, None, None, None] * noise)
