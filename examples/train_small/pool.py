"""The pictures that are learned from: made once, in several processes, and kept in a folder."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import torch
from safetensors.torch import load_file, save_file

from gsedit.files.atomic import atomic_path
from train_small.pictures import procedural
from train_small.random_scenes import traced
from train_small.sources import Stored, cat_stored, store


@dataclass(frozen=True)
class Chunk:
    """Pictures that are made in one go, from one seed."""

    seed: int
    size: int = 192
    """Pixels; they are square."""
    procedural: int = 224
    traced: int = 24

    @property
    def name(self) -> str:
        return f"{self.seed}_{self.size}_{self.procedural}_{self.traced}.safetensors"


def pool(folder: Path, chunks: Sequence[Chunk], processes: int = 1) -> Stored:
    """All chunks in their order; those that are not in the folder yet are made, and stay there."""
    folder.mkdir(parents=True, exist_ok=True)
    missing = [chunk for chunk in chunks if not (folder / chunk.name).exists()]
    if missing and processes > 1:
        with ProcessPoolExecutor(processes, get_context("spawn"), _alone) as workers:
            list(workers.map(partial(_make, folder), missing))
    else:
        for chunk in missing:
            _make(folder, chunk)
    return cat_stored([Stored(**load_file(folder / chunk.name)) for chunk in chunks])


def _make(folder: Path, chunk: Chunk) -> None:
    generator = torch.Generator().manual_seed(chunk.seed)
    made = [store(procedural(chunk.procedural, chunk.size, generator))]
    if chunk.traced:
        made.append(store(traced(chunk.traced, chunk.size, generator)))
    with atomic_path(folder / chunk.name, overwrite=True) as temporary:
        columns = vars(cat_stored(made)).items()
        save_file({name: column.contiguous() for name, column in columns}, temporary)


def _alone() -> None:
    torch.set_num_threads(1)  # the processes are what runs in parallel
