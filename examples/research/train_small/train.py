"""Train the editor `small` from scratch: about three hours on two cores, 4 GB of memory.

python -m research.train_small.train OUT [--device cuda]

The pictures are those of OUT/pictures; missing ones are made first. The training may be stopped at
any time: called again, it continues from its last checkpoint, at most 500 steps back. The weights
are OUT/small.safetensors; train_small.score evaluates them.
"""

from __future__ import annotations

import argparse
import copy
import sys
from collections.abc import Sequence
from pathlib import Path

import torch

from gsedit.diffusion.precision import has_bfloat16
from gsedit.editors.small.denoiser import Small, save_small
from gsedit.editors.small.network import SmallNetwork
from gsedit.errors import UsageError
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
    device: str = "cpu",
) -> None:
    """Train, or continue from the checkpoint in the folder, and leave the weights there.

    Pictures are made and cropped on the CPU, the network is on the `device`. Raises UsageError
    where there is no such device.
    """
    torch.manual_seed(SEED)
    fast = device != "cpu" or has_bfloat16()
    precision = torch.bfloat16 if fast else torch.float32
    state = TrainingState(
        on_device(network or SmallNetwork(), device),
        torch.Generator().manual_seed(SEED),
        TrainSettings(precision=precision),
    )
    checkpoint = folder / "state.pt"
    if checkpoint.exists():
        state.load_state_dict(torch.load(checkpoint, map_location="cpu"))
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


def on_device(network: SmallNetwork, device: str) -> SmallNetwork:
    """The network on a device of torch. Raises UsageError where there is no such device."""
    try:
        return network.to(device)
    except (RuntimeError, AssertionError) as error:  # a build without CUDA asserts
        reason = str(error).split("\n", 1)[0]
        raise UsageError(f"--device {device} cannot be used ({reason}): leave it out") from None


def save(state: TrainingState, folder: Path) -> None:
    """Write the weights, and the checkpoint from which the training continues."""
    average = copy.deepcopy(state.average).cpu()
    small = Small(average, looks=tuple(TARGET_EDITS), words=look_words())
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
    parser.add_argument("--device", default="cpu", help="a device of torch: cpu, cuda, ...")
    options = parser.parse_args(arguments)
    train(options.folder, device=options.device)


if __name__ == "__main__":
    main()
