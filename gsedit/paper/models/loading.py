"""A model of any family, from a folder or a hub id."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import torch

from gsedit.errors import InputError, UsageError
from gsedit.paper.diffusion.precision import GB, SHARE, free_bytes
from gsedit.paper.diffusion.settings import Precision
from gsedit.paper.models.hub import (
    INDEX,
    Family,
    Part,
    family_of,
    find,
    inspect,
    require,
    settings_in,
)
from gsedit.paper.models.model import Model

DTYPES = {"F32": torch.float32, "F16": torch.float16, "BF16": torch.bfloat16}
"""By their names in the headers of safetensors files."""


def load_model(model: str | Path, *, precision: Precision = "auto") -> Model:
    """The model of a folder, or of a hub id in the hub's cache.

    Only safetensors are read, and no code that comes with a model is run. Raises UsageError without
    diffusers or memory, InputError for a model that is missing, incomplete, a pickle or of another
    kind.
    """
    place = find(str(model))
    try:
        for library in ("accelerate", "diffusers", "transformers"):
            import_module(library)
    except ImportError as error:
        raise UsageError(
            f"the editors pix2pix and diffusers need {error.name}: pip install 'gsedit[diffusers]'"
        ) from error
    parts = Parts.of(place, precision)
    return import_module(f"gsedit.paper.models.{parts.family.module}").load(parts)


@dataclass(frozen=True, eq=False)
class Parts:
    """The components of a model, loaded one at a time. Every method raises InputError."""

    folder: Path
    index: dict[str, Any]
    """The contents of model_index.json: classes of the components, and the pipeline's settings."""
    family: Family
    held: dict[str, Part]
    precision: Precision = "auto"
    """Precision of the weights in memory; auto: as they are stored, see `dtype`."""

    @classmethod
    def of(cls, folder: Path, precision: Precision = "auto") -> Parts:
        """The parts of a folder that is whole."""
        held = inspect(folder)
        require(held)
        index = settings_in(folder / INDEX)
        parts = {part.name: part for part in held}
        made = cls(folder, index, family_of(index, folder), parts, precision)
        made.check_memory()
        return made

    def settings(self, name: str) -> dict[str, Any]:
        """The scheduler's settings, or those of another component, `_class_name` among them."""
        return settings_in(self.folder / name / f"{name}_config.json")

    def network(self, name: str) -> Any:
        """A network, for inference; the VAE always in float32."""
        part, kind = self.held[name], self._kind(name)
        is_text = name.startswith("text_encoder")
        dtype = torch.float32 if name == "vae" else self.dtype(name)
        options = {"dtype" if is_text else "torch_dtype": dtype, "variant": part.variant}
        network, found = self._load(
            kind, name, use_safetensors=True, output_loading_info=True, low_cpu_mem_usage=True,
            ignore_mismatched_sizes=is_text, **options,
        )  # fmt: skip
        wrong = [f"{key} is {tuple(a)}, not {tuple(b)}" for key, a, b in found["mismatched_keys"]]
        if wrong := [*wrong, *(f"{key} is missing" for key in sorted(found["missing_keys"]))]:
            raise InputError(
                f"{self.folder / name} has weights of another shape than its config.json "
                f"({wrong[0]}): the two are of different models; download both again"
            )
        return network.eval().requires_grad_(False)  # score distillation needs none of weights

    def tokenizer(self, name: str, kind: Any = None) -> Any:
        """A tokenizer or processor of transformers; one that brings its own code is refused."""
        kind = kind or self._kind(name)
        is_auto = kind.__name__.startswith("Auto")  # it would ask on the terminal, and run the code
        return self._load(kind, name, **({"trust_remote_code": False} if is_auto else {}))

    def dtype(self, name: str) -> torch.dtype:
        """The dtype of a component in memory.

        As stored with auto; but half precision without bfloat16's range overflows, and few
        processors compute in it: it becomes float32 where the whole model fits into half of the
        free memory so, bfloat16 elsewhere.
        """
        if self.precision != "auto":
            return getattr(torch, self.precision)
        stored = DTYPES.get(self.held[name].stored, torch.float32)
        if stored != torch.float16:
            return stored
        size = 2 * sum(part.size for part in self.held.values())
        return torch.float32 if size <= SHARE * free_bytes() else torch.bfloat16

    def check_memory(self) -> None:
        """Raise UsageError where weights that are converted as asked take more than is free.

        Weights in their stored dtype are mapped from the disk, and take what is free.
        """
        needed, free = 0, free_bytes()
        for name in self.family.networks if self.precision != "auto" else ():
            stored, dtype = DTYPES.get(self.held[name].stored), self.dtype(name)
            if stored and dtype != stored:
                needed += self.held[name].size * dtype.itemsize // stored.itemsize
        if needed > free:
            raise UsageError(
                f"{self.folder} takes {needed / GB:.1f} GB of memory in {self.precision}, and "
                f"{free / GB:.1f} GB are free: add --set precision=auto, close other programs, "
                "or take a smaller model"
            )

    def _kind(self, name: str) -> Any:
        """The class of a component, of diffusers or transformers, as model_index.json names it."""
        library, kind = self.index.get(name) or (None, None)
        if library not in ("diffusers", "transformers") or not isinstance(kind, str):
            raise InputError(f"{self.folder / INDEX}: {name} is no class of diffusers: {library}")
        found = getattr(import_module(library), kind, None)
        if found is None:
            raise InputError(f"{self.folder / INDEX}: {library} has no {kind}: upgrade {library}")
        return found

    def _load(self, kind: Any, name: str, **options: Any) -> Any:
        path = str(self.folder / name)
        with explained(path), quiet():
            return kind.from_pretrained(path, local_files_only=True, **options)


@contextmanager
def explained(what: str) -> Iterator[None]:
    """Make an InputError of whatever these libraries raise, which is what their backends do."""
    try:
        yield
    except InputError:
        raise
    except Exception as error:
        reason = next(iter(str(error).strip().splitlines()), type(error).__name__)
        reason = reason.partition(". If you want to instead")[0]  # diffusers' own next move
        raise InputError(f"{what} cannot be loaded ({reason}): download the model again") from error


@contextmanager
def quiet() -> Iterator[None]:
    """Without the progress bars and reports of the libraries: what is wrong is raised."""
    import diffusers
    import transformers

    logs = diffusers.utils.logging, transformers.utils.logging
    levels = [log.get_verbosity() for log in logs]
    for log in logs:
        log.set_verbosity_error()
        log.disable_progress_bar()
    try:
        yield
    finally:
        for log, level in zip(logs, levels):
            log.set_verbosity(level)
            log.enable_progress_bar()
