"""The training pictures: made once, in several processes, and kept in a folder."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import torch
from safetensors.torch import load_file, save_file

from gsedit.storage.atomic import atomic_path
from research.train_small.pictures import procedural
from research.train_small.random_scenes import traced
from research.train_small.sources import PackedSources, cat_packed, pack


@dataclass(frozen=True)
class Chunk:
    """Pictures that are made in one go, from one seed, and kept in one file."""

    seed: int
    size: int = 192
    """Pixels; they are square."""
    procedural: int = 224
    """How many are ray-cast (see pictures)."""
    traced: int = 24
    """How many are sphere-traced (see random_scenes)."""

    @property
    def count(self) -> int:
        """Number of pictures in all."""
        return self.procedural + self.traced

    @property
    def file_name(self) -> str:
        return f"{self.seed}_{self.size}_{self.procedural}_{self.traced}.safetensors"


def cached_pictures(folder: Path, chunks: Sequence[Chunk], processes: int = 1) -> PackedSources:
    """All chunks in their order; those that are not in the folder yet are made, and kept there."""
    folder.mkdir(parents=True, exist_ok=True)
    missing = [chunk for chunk in chunks if not (folder / chunk.file_name).exists()]
    if missing and processes > 1:
        with ProcessPoolExecutor(processes, get_context("spawn"), _use_one_thread) as workers:
            list(workers.map(partial(_make, folder), missing))
    else:
        for chunk in missing:
            _make(folder, chunk)
    return cat_packed([PackedSources(**load_file(folder / chunk.file_name)) for chunk in chunks])


def _make(folder: Path, chunk: Chunk) -> None:
    generator = torch.Generator().manual_seed(chunk.seed)
    parts = [pack(procedural(chunk.procedural, chunk.size, generator))]
    if chunk.traced:
        parts.append(pack(traced(chunk.traced, chunk.size, generator)))
    with atomic_path(folder / chunk.file_name, overwrite=True) as temporary:
        columns = vars(cat_packed(parts)).items()
        save_file({name: column.contiguous() for name, column in columns}, temporary)


def _use_one_thread() -> None:
    torch.set_num_threads(1)  # the processes are what runs in parallel
