"""Settings of a training: of its phases and of the whole."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from gsedit.errors import UsageError


@dataclass(frozen=True)
class Phase:
    """Some steps at one size of pictures."""

    size: int
    """Size of the pictures, pixels a side."""
    steps: int
    batch: int
    """Number of pictures a step."""
    edits: int = 2
    """Prompts and targets per picture, which is encoded once for all of them."""
    rate_factor: float = 1.0
    """On the learning rate of the settings."""
    pictures: int | None = None
    """Only the first so many of the pictures; None: all."""
    augmented_prompts: float = 0.0
    """Share of the prompts that are augmented (see prompts.augmented)."""
    distractors: float = 0.0
    """Share of the inserted words that come from other prompts; the others are nonsense."""


@dataclass(frozen=True)
class TrainSettings:
    """Settings that hold for the whole training."""

    learning_rate: float = 1e-3
    """Learning rate of AdamW at its peak."""
    warm_up: int = 200
    """Steps of a round in which the rate rises; in the others it falls as half a cosine."""
    weight_decay: float = 0.01
    ema_decay: float = 0.999
    """Decay of the moving average of the weights; the average is the result."""
    condition_dropout: float = 0.05
    """Share of samples without their picture and with their text, and the same share without
    either; of the samples with their picture, the share without text. In [0, 1/3]
    (InstructPix2Pix drops 5 % each)."""
    geometry_weight: float = 0.1
    """Weight of the image encoder's geometry loss: at the start it is about as large as the
    edit's."""
    precision: torch.dtype = torch.bfloat16
    """Dtype of the matrix products; float32 where the processor has no bfloat16."""

    def __post_init__(self) -> None:
        if not 0 <= self.condition_dropout <= 1 / 3:
            raise UsageError(f"condition_dropout {self.condition_dropout} is not in [0, 1/3]")
