"""What the small editor learns from: pictures made here, sentences, and their true edits.

`pool` makes the pictures, `lessons` gives each a sentence and its answer, `train_steps` teaches a
network and `score` examines any editor.
"""

from train_small.pool import Chunk, pool
from train_small.scoring import Case, Score, judge, score, summary
from train_small.sources import Sources, Stored
from train_small.training import Phase, Student, TrainSettings, train_steps

__all__ = [
    "Case",
    "Chunk",
    "Phase",
    "Score",
    "Sources",
    "Stored",
    "Student",
    "TrainSettings",
    "judge",
    "pool",
    "score",
    "summary",
    "train_steps",
]
