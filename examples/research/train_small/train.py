"""Train the editor `small` from scratch: about three hours on two cores, 4 GB of memory.

python -m research.train_small.train OUT

The pictures are those of OUT/pictures; missing ones are made first. The training may be stopped at
any time: called again, it continues from its last checkpoint, at most 500 steps back. The weights
are OUT/small.safetensors; train_small.score evaluates them.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import torch

from gsedit.diffusion.precision import has_bfloat16
from gsedit.editors.small.denoiser import Small, save_small
from gsedit.editors.small.network import SmallNetwork
from gsedit.storage.atomic import atomic_path
from research.train_small.picture_cache import Chunk, cached_pictures
from research.train_small.prompts import look_words
from research.train_small.recipe import CHUNKS, ROUNDS, SEED
from research.train_small.settings import Phase, TrainSettings
from research.train_small.target_edits import TARGET_EDITS
from research.train_small.training import TrainingState, train_steps

REPORT_EVERY, CHECKPOINT_EVERY = 100, 500  # steps


def train(
    folder: Path,
    chunks: Sequence[Chunk] = CHUNKS,
    rounds: Sequence[Sequence[Phase]] = ROUNDS,
    network: SmallNetwork | None = None,
) -> None:
    """Train, or continue from the checkpoint in the folder, and leave the weights there."""
    torch.manual_seed(SEED)
    precision = torch.bfloat16 if has_bfloat16() else torch.float32
    state = TrainingState(
        network or SmallNetwork(),
        torch.Generator().manual_seed(SEED),
        TrainSettings(precision=precision),
    )
    checkpoint = folder / "state.pt"
    if checkpoint.exists():
        state.load_state_dict(torch.load(checkpoint))
    pictures = cached_pictures(folder / "pictures", chunks, processes=torch.get_num_threads())
    losses = list[float]()
    for report in train_steps(state, pictures, *rounds):
        losses.append(report.loss)
        if report.step % REPORT_EVERY == 0:
            loss = sum(losses) / len(losses)
            message = f"step {report.step} of {report.steps}: loss {loss:.5f}"
            sys.stdout.write(f"{message}, {report.seconds:.0f} s\n")
            sys.stdout.flush()
            losses.clear()
        if report.step % CHECKPOINT_EVERY == 0:
            save(state, folder)
    save(state, folder)


def save(state: TrainingState, folder: Path) -> None:
    """Write the weights, and the checkpoint from which the training continues."""
    small = Small(state.average, looks=tuple(TARGET_EDITS), words=look_words())
    metadata = {"seed": str(SEED), "steps": str(state.step)}
    save_small(small, folder / "small.safetensors", metadata)
    with atomic_path(folder / "state.pt", overwrite=True) as temporary:
        torch.save(state.state_dict(), temporary)


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        prog="research.train_small.train",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("folder", type=Path, metavar="OUT")
    train(parser.parse_args(arguments).folder)


if __name__ == "__main__":
    main()
