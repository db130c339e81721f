"""The recipe of the weights that come with gsedit: seed, pictures, and rounds of training."""

from __future__ import annotations

from research.train_small.picture_cache import Chunk
from research.train_small.settings import Phase

SEED = 0
CHUNKS = tuple(Chunk(1000 + i) for i in range(20))  # of 248 pictures
FIRST_ROUND_PICTURES = 12 * 248
ROUNDS = (
    (
        Phase(size=64, steps=2500, batch=24, pictures=FIRST_ROUND_PICTURES),
        Phase(size=128, steps=6000, batch=12, pictures=FIRST_ROUND_PICTURES),
        Phase(size=192, steps=800, batch=8, pictures=FIRST_ROUND_PICTURES),
    ),
    (
        Phase(size=128, steps=3800, batch=12, rate_factor=0.6, augmented_prompts=0.5),
        Phase(size=192, steps=500, batch=8, rate_factor=0.6, augmented_prompts=0.5),
    ),
    (
        Phase(
            size=128, steps=1100, batch=12, rate_factor=0.4,
            augmented_prompts=0.7, distractors=0.7,
        ),
        Phase(
            size=192, steps=150, batch=8, rate_factor=0.4,
            augmented_prompts=0.7, distractors=0.7,
        ),
    ),
)  # fmt: skip
