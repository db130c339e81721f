"""The parts of a model's folder, loaded one at a time, for the families to build on."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from gsedit.diffusion.memory import GB, SHARE, free_bytes
from gsedit.diffusion.settings import Precision
from gsedit.errors import InputError, UsageError
from gsedit.models.families import Family
from gsedit.models.single_file import COSXL_SCHEDULER, SingleFile
from gsedit.models.text_networks import TextNetwork
from gsedit.models.weights import Weights, config_of, inspect


def network_of(
    file: SingleFile, settings: Path, name: str, kind: Any, dtype: torch.dtype
) -> torch.nn.Module:
    """A network of diffusers (`kind`) with the settings in `settings`/`name`.

    Raises InputError for weights that it lacks, and what diffusers does for others.
    """
    try:
        network = kind.from_single_file(
            str(file.path), config=str(settings), subfolder=name, local_files_only=True,
            torch_dtype=dtype, **file.overrides(name),
        )  # fmt: skip
    except NotImplementedError:  # torch cannot convert weights that no file gave
        raise _lacking(file, settings / name) from None
    return _whole(network, file, settings / name)


def text_encoder_of(
    file: SingleFile, settings: Path, name: str, kind: Any, dtype: torch.dtype
) -> torch.nn.Module:
    """A text encoder of transformers, as `network_of`."""
    from diffusers.loaders.single_file_utils import (
        create_diffusers_clip_model_from_ldm,
        load_single_file_checkpoint,
    )

    held = load_single_file_checkpoint(str(file.path))
    network = create_diffusers_clip_model_from_ldm(
        kind, held, subfolder=name, config=str(settings), torch_dtype=dtype, local_files_only=True
    )
    return _whole(network, file, settings / name)


def _whole(network: Any, file: SingleFile, place: Path) -> torch.nn.Module:
    """The network. Raises InputError where the file lacks some of its weights."""
    if any(each.is_meta for each in network.parameters()):
        raise _lacking(file, place)
    return network


def _lacking(file: SingleFile, place: Path) -> InputError:
    return InputError(
        f"{file.path} lacks weights of the network in {place}/config.json: the two are of different"
        " models, or the file is a part of one; take the settings of the file's own"
    )


DTYPES = {"F32": torch.float32, "F16": torch.float16, "BF16": torch.bfloat16}
"""By their names in the headers of safetensors files."""
Convert = Callable[..., torch.nn.Module]
"""(file, folder of settings, name of the component, class, dtype) -> network."""


@dataclass(frozen=True)
class Parts:
    """A complete model's folder. Every method raises InputError with the part's place."""

    weights: Weights
    precision: Precision = "auto"
    """Precision of the weights in memory; auto: as they are stored, see `dtype`."""

    @classmethod
    def of(
        cls, folder: str | Path, precision: Precision = "auto", settings: Path | None = None
    ) -> Parts:
        """The parts of a folder, or of a single file with this folder of settings (None: the one
        beside it). Raises InputError where it is incomplete or of another kind."""
        return cls(inspect(folder, settings).require(), precision)

    @property
    def folder(self) -> Path:
        return self.weights.folder

    @property
    def family(self) -> Family:
        return self.weights.family

    @property
    def pipeline(self) -> str:
        """Class of diffusers' pipeline, as in model_index.json."""
        return self.weights.kind.pipeline

    def pipeline_config(self) -> dict[str, Any]:
        """The settings of the whole pipeline; none where the folder has no model_index.json."""
        file, path = self.weights.file, self.folder / "model_index.json"
        settings = config_of(path) if path.exists() else {}
        return settings if file is None else settings | {"is_cosxl_edit": file.is_cosxl}

    def scheduler_config(self) -> dict[str, Any]:
        """The scheduler's settings, `_class_name` among them; none where it has no file."""
        if self.weights.file is not None and self.weights.file.is_cosxl:
            return dict(COSXL_SCHEDULER)
        path = self.folder / "scheduler" / "scheduler_config.json"
        config = config_of(path) if path.exists() else {}
        name = self.weights.kind.scheduler
        return config | {"_class_name": name} if name else config

    def network(self, name: str, kind: Any) -> Any:
        """A network of diffusers, for inference; the VAE always in float32."""
        dtype = torch.float32 if name == "vae" else self.dtype(name)
        if self.weights.file is not None:
            return self._converted(network_of, self.weights.file, name, kind, dtype)
        return self._weighted(name, kind, torch_dtype=dtype, low_cpu_mem_usage=True)

    def text_encoder(
        self, name: str, kind: Any, used: Callable[[Any], Any] | None = None
    ) -> TextNetwork:
        """A network of transformers, for inference; `used` gives the part of it that is used."""
        dtype, file = self.dtype(name), self.weights.file

        def load() -> Any:
            if file is not None:
                network = self._converted(text_encoder_of, file, name, kind, dtype)
            else:
                network = self._weighted(name, kind, dtype=dtype, ignore_mismatched_sizes=True)
            return network if used is None else used(network)

        return TextNetwork(load)

    def tokenizer(self, name: str, kind: Any) -> Any:
        """A tokenizer or processor of transformers; one that brings its own code is refused."""
        is_auto = kind.__name__.startswith("Auto")  # it would ask on the terminal, and run the code
        return self._load(name, kind, **({"trust_remote_code": False} if is_auto else {}))

    def dtype(self, name: str) -> torch.dtype:
        """The dtype of a component in memory.

        As stored with auto; but half precision without bfloat16's range overflows, and few
        processors compute in it: it becomes float32 where the whole model fits into half of the
        free memory so, bfloat16 elsewhere.
        """
        if self.precision != "auto":
            return getattr(torch, self.precision)
        part = self.weights.part(name)
        stored = DTYPES.get(part.stored if part else "", torch.float32)
        if stored != torch.float16:
            return stored
        size = 2 * sum(part.size for part in self.weights.parts)
        return torch.float32 if size <= SHARE * free_bytes() else torch.bfloat16

    def check_memory(self) -> None:
        """Raise UsageError where weights that are converted as asked take more than is free.

        Weights in their stored dtype are mapped from the disk, and take what is free.
        """
        if self.precision == "auto":
            return
        needed = 0
        for part in self.weights.parts:
            stored = DTYPES.get(part.stored)
            dtype = torch.float32 if part.name == "vae" else self.dtype(part.name)
            if stored and dtype != stored:
                needed += part.size * dtype.itemsize // stored.itemsize
        free = free_bytes()
        if needed > free:
            raise UsageError(
                f"{self.weights.place} takes {needed / GB:.1f} GB of memory in {self.precision}, "
                f"and {free / GB:.1f} GB are free: add --set precision=auto, close other programs, "
                "or take a smaller model"
            )

    def _weighted(self, name: str, kind: Any, **options: Any) -> Any:
        part = self.weights.part(name)
        variant = part.variant if part else None
        options |= {"use_safetensors": True, "variant": variant, "output_loading_info": True}
        network, found = self._load(name, kind, **options)
        missing = sorted(found["missing_keys"])
        other = [
            f"{key} is {tuple(held)}, not {tuple(wanted)}"
            for key, held, wanted in found["mismatched_keys"]
        ]
        if wrong := [*other, *(f"{key} is missing" for key in missing)]:
            more = f" and {len(wrong) - 1} more" if len(wrong) > 1 else ""
            raise InputError(
                f"{self.folder / name} has weights of another shape than its config.json "
                f"({wrong[0]}{more}): the two are of different models; download both again"
            )
        return network.eval().requires_grad_(False)  # score distillation needs no other gradients

    def _converted(self, convert: Convert, file: SingleFile, name: str, *args: Any) -> Any:
        """A network of the single file, for inference."""
        with explained(f"{name} of {file.path}"), quiet():
            network = convert(file, self.folder, name, *args)
        return network.eval().requires_grad_(False)

    def _load(self, name: str, kind: Any, **options: Any) -> Any:
        path = self.folder / name
        with explained(str(path)), quiet():
            return kind.from_pretrained(str(path), local_files_only=True, **options)


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
