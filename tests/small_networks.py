"""Small networks whose passes take milliseconds."""

from __future__ import annotations

import torch

from gsedit.paper.editors.small.network import Architecture, SmallNetwork

TINY = Architecture(
    image_encoder=(32, 32, 64), denoiser=(16, 32), attention_levels=1, pixel_features=4,
    pixel_mlp=8, embedding=32, text_width=32,
)  # fmt: skip


def random_network(architecture: Architecture = TINY, seed: int = 0) -> SmallNetwork:
    """A network none of whose layers is zero, as after training."""
    torch.manual_seed(seed)
    network = SmallNetwork(architecture).eval().requires_grad_(False)
    for name, value in network.named_parameters():
        if value.dim() > 1 and not value.any():
            torch.nn.init.normal_(value, std=0.02)
        elif not name.endswith("norm.weight"):
            value += 0.01 * torch.randn(value.shape)
    return network
