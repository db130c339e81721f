"""Train the editor `small` from scratch: about three hours on two cores, 4 GB of memory.

python examples/train_small.py out/small

First it makes its pictures (ten minutes, 1.6 GB; kept in out/small/pictures), then it trains. It
may be stopped at any time: called again, it goes on from the last 500 steps. The weights are
out/small/small.safetensors; examples/score_small.py says how good they are.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import torch

from gsedit.diffusion.machine import has_bfloat16
from gsedit.editors.small import Small, SmallNetwork, save_small
from gsedit.files.atomic import atomic_path
from train_small import Chunk, Phase, Student, TrainSettings, pool, train_steps
from train_small.phrases import telling_words
from train_small.target_edits import TRUTHS

SEED = 0
CHUNKS = tuple(Chunk(1000 + i) for i in range(20))  # of 248 pictures
FEWER = 12 * 248
ROUNDS = (
    (
        Phase(size=64, steps=2500, batch=24, pictures=FEWER),
        Phase(size=128, steps=6000, batch=12, pictures=FEWER),
        Phase(size=192, steps=800, batch=8, pictures=FEWER),
    ),
    (
        Phase(size=128, steps=3800, batch=12, rate=0.6, strange=0.5),
        Phase(size=192, steps=500, batch=8, rate=0.6, strange=0.5),
    ),
    (
        Phase(size=128, steps=1100, batch=12, rate=0.4, strange=0.7, borrowed=0.7),
        Phase(size=192, steps=150, batch=8, rate=0.4, strange=0.7, borrowed=0.7),
    ),
)
REPORT, SAVE = 100, 500  # steps


def train(
    folder: Path,
    chunks: Sequence[Chunk] = CHUNKS,
    rounds: Sequence[Sequence[Phase]] = ROUNDS,
    network: SmallNetwork | None = None,
) -> None:
    """Train, or go on with it, and leave the weights in the folder."""
    torch.manual_seed(SEED)
    precision = torch.bfloat16 if has_bfloat16() else torch.float32
    student = Student(
        network or SmallNetwork(),
        torch.Generator().manual_seed(SEED),
        TrainSettings(precision=precision),
    )
    kept = folder / "state.pt"
    if kept.exists():
        student.restore(torch.load(kept))
    stored = pool(folder / "pictures", chunks, processes=torch.get_num_threads())
    losses = list[float]()
    for trained in train_steps(student, stored, *rounds):
        losses.append(trained.loss)
        if trained.step % REPORT == 0:
            told = f"step {trained.step} of {trained.steps}: loss {sum(losses) / len(losses):.5f}"
            sys.stdout.write(f"{told}, {trained.seconds:.0f} s\n")
            sys.stdout.flush()
            losses.clear()
        if trained.step % SAVE == 0:
            save(student, folder)
    save(student, folder)


def save(student: Student, folder: Path) -> None:
    """The weights, and what it takes to go on."""
    small = Small(student.average, looks=tuple(TRUTHS), words=telling_words())
    told = {"seed": str(SEED), "steps": str(student.step)}
    save_small(small, folder / "small.safetensors", told)
    with atomic_path(folder / "state.pt", overwrite=True) as temporary:
        torch.save(student.state(), temporary)


if __name__ == "__main__":
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("folder", type=Path)
    train(asked.parse_args().folder)
