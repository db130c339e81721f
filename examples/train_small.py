"""Train the editor `small` from scratch: about an hour and a quarter on two cores.

python examples/train_small.py out/small

First it makes its pictures (some minutes; kept in out/small/pictures), then it trains. It may be
stopped at any time: called again, it goes on. The weights are out/small/small.safetensors;
`python examples/score_small.py out/small/small.safetensors` says how good they are.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable
from pathlib import Path

import torch

from gsedit.editors.small import Network, Small, save_small
from gsedit.files.atomic import atomic_path
from gsedit.teaching import Chunk, Phase, Student, pool, train_steps
from gsedit.teaching.phrases import telling_words
from gsedit.teaching.truths import TRUTHS

SEED = 0
CHUNKS = tuple(Chunk(1000 + i) for i in range(12))
PHASES = (
    Phase(size=64, steps=2500, batch=24),
    Phase(size=128, steps=6000, batch=12),
    Phase(size=192, steps=800, batch=8),
)
REPORT, SAVE = 100, 500  # steps


def train(folder: Path, chunks: Iterable[Chunk] = CHUNKS, phases: Iterable[Phase] = PHASES) -> None:
    """Train, or go on with it, and leave the weights in the folder."""
    phases, chunks = tuple(phases), tuple(chunks)
    stored = pool(folder / "pictures", chunks, processes=torch.get_num_threads())
    torch.manual_seed(SEED)
    student = Student(Network(), torch.Generator().manual_seed(SEED))
    kept = folder / "state.pt"
    if kept.exists():
        student.restore(torch.load(kept))
    losses = []
    for trained in train_steps(student, stored, phases):
        losses.append(trained.loss)
        if trained.step % REPORT == 0:
            told = f"step {trained.step} of {trained.steps}: loss {sum(losses) / len(losses):.5f}"
            sys.stdout.write(f"{told}, {trained.seconds:.0f} s\n")
            sys.stdout.flush()
            losses.clear()
        if trained.step % SAVE == 0 or trained.step == trained.steps:
            told = {"seed": str(SEED), "step": f"{trained.step} of {trained.steps}"}
            small = Small(student.average, looks=tuple(TRUTHS), words=telling_words())
            save_small(small, folder / "small.safetensors", told)
            with atomic_path(kept, overwrite=True) as temporary:
                torch.save(student.state(), temporary)


if __name__ == "__main__":
    train(Path(sys.argv[1] if len(sys.argv) > 1 else "out/small"))
