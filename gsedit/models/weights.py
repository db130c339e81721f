"""Whether a model's folder is complete, by names, configs and headers; no tensor is read.

The layout is diffusers': a folder a component, its settings and safetensors in it. Of a single file
the weights are in the file, all else in such a folder.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any

from gsedit.errors import InputError
from gsedit.models.families import SD, SDXL, Component, Family
from gsedit.models.headers import Stored, tensors
from gsedit.models.layout import (
    CONFIGS,
    INDEX,
    VARIANT,
    Kind,
    identify,
    index_name,
    single_name,
)
from gsedit.models.single_file import (
    COSXL_SCHEDULER,
    SingleFile,
    main_dtype,
    read_single_file,
    settings_beside,
)
from gsedit.storage.json_files import object_of, read_json

PICKLES = (".bin", ".ckpt", ".pt", ".pth")
NO_PICKLE = "a pickle runs whatever code is in it when it is opened, so gsedit opens none"
AGAIN = "download the model again"
TOKENIZERS = (("tokenizer.json",), ("vocab.json", "merges.txt"), ("spiece.model",))
"""Files of which one group is enough for a tokenizer; the second is CLIP's."""
PROCESSORS = (("preprocessor_config.json",), ("processor_config.json",))


@dataclass(frozen=True)
class Part:
    """One component of a model, as it lies on disk."""

    name: str
    problems: tuple[str, ...] = ()
    """Problems of the part, each with its next move; empty for a complete part."""
    files: tuple[str, ...] = ()
    """Complete files of weights, relative to the model's folder."""
    size: int = 0
    """Size of the files in bytes."""
    variant: str | None = None
    """`fp16` where only that copy is there."""
    stored: str = ""
    """The dtype that most bytes of the weights have, as safetensors names it (F32, F16, BF16)."""


@dataclass(frozen=True)
class Weights:
    """The contents of a model's folder."""

    folder: Path
    kind: Kind
    parts: tuple[Part, ...]
    notes: tuple[str, ...] = ()
    """Notes on harmless oddities of the folder."""
    file: SingleFile | None = None
    """The file with the weights; the folder has then only settings and tokenizers."""

    @property
    def family(self) -> Family:
        """Family of the model's architecture."""
        return self.kind.family

    @property
    def problems(self) -> tuple[str, ...]:
        """Those of all parts."""
        return tuple(chain.from_iterable(part.problems for part in self.parts))

    @property
    def complete(self) -> bool:
        """Whether it can be loaded."""
        return not self.problems

    @property
    def place(self) -> Path:
        """The file or folder with the weights."""
        return self.folder if self.file is None else self.file.path

    def part(self, name: str) -> Part | None:
        """The part of that name, None where the model has none."""
        return next((each for each in self.parts if each.name == name), None)

    def require(self) -> Weights:
        """Itself, if complete. Raises InputError with the first problem and the number of more."""
        if self.complete:
            return self
        first, *more = self.problems
        rest = f" (and {len(more)} more: gsedit doctor {self.place} lists them)" if more else ""
        raise InputError(f"{first}{rest}")


def inspect(folder: str | Path, settings: Path | None = None) -> Weights:
    """Inspect a model's folder, or a single file of weights, without loading it.

    `settings` is the folder with what a single file lacks; None: one beside it. Raises InputError
    where there is no such folder or settings, or it holds a model of a family that is not known.
    """
    folder = Path(folder).expanduser()
    if folder.is_file():
        return _of_file(folder, settings)
    if not folder.is_dir():
        raise InputError(
            f"{folder}: there is no such folder; give the one that holds {INDEX}, unet/ or "
            "transformer/"
        )
    index = config_of(folder / INDEX) if (folder / INDEX).exists() else None
    if index is None and (folder / "unet" / "config.json").exists():
        config_of(folder / "unet" / "config.json")  # the only file that tells what an old folder is
    kind = identify(str(folder), lambda name: index if name == INDEX else _settings(folder / name))
    is_sd = kind.family in (SD, SDXL)
    used = kind.family.components
    parts = [_part(folder, each) for each in used if not (is_sd and each.role == "scheduler")]
    if is_sd:
        parts[0] = _checked_channels(folder, parts[0])
    return Weights(folder, kind, tuple(parts), _notes(folder, kind, [part.name for part in parts]))


def config_of(path: Path) -> dict[str, Any]:
    """The settings in a JSON file. Raises InputError."""
    if not path.exists():
        raise InputError(f"{path} is missing: {AGAIN}")
    return read_json(path, object_of({}), advice=AGAIN)


def _settings(path: Path) -> Mapping[str, Any] | None:
    """The settings in a file; None where there are none, which is the part's problem."""
    try:
        return config_of(path)
    except InputError:
        return None


def _part(folder: Path, component: Component) -> Part:
    """A component with everything that is wrong with it."""
    place = folder / component.name
    if not place.is_dir():
        missing = f"{folder} has no {component.name}/: download that folder of the model too"
        return Part(component.name, (missing,))
    if component.role == "words":
        return _words(place)
    problems = []
    try:
        config_of(place / CONFIGS[component.role])
    except InputError as error:
        problems.append(str(error))
    if component.role == "scheduler":
        return Part(component.name, tuple(problems))
    try:
        files, variant = _weight_files(folder, component)
    except InputError as error:
        return Part(component.name, (*problems, str(error)))
    whole: list[Path] = []
    held: list[Stored] = []
    for file in files:
        try:
            held += tensors(file).values()
            whole.append(file)
        except InputError as error:
            problems.append(str(error))
    names = tuple(file.relative_to(folder).as_posix() for file in whole)
    size = sum(file.stat().st_size for file in whole)
    return Part(component.name, tuple(problems), names, size, variant, main_dtype(held))


def _weight_files(folder: Path, component: Component) -> tuple[list[Path], str | None]:
    """(the files that hold a component's weights, their variant). Raises InputError for none."""
    for variant in (None, VARIANT):
        single = folder / single_name(component, variant)
        if single.is_file():
            return [single], variant
        index = folder / index_name(component, variant)
        if index.is_file():
            shards = config_of(index).get("weight_map")
            if not isinstance(shards, dict) or not shards:
                raise InputError(f"{index} names no files: {AGAIN}")
            names = sorted({str(name) for name in shards.values()})
            if outside := [name for name in names if Path(name).name != name]:
                raise InputError(
                    f"{index} names {outside[0]!r}, which is no file beside it: {AGAIN}"
                )
            return [index.parent / name for name in names], variant
    place, wanted = folder / component.name, Path(single_name(component, None)).name
    pickles = sorted(path.name for path in place.iterdir() if path.suffix in PICKLES)
    if pickles:
        raise InputError(
            f"{place} has only {', '.join(pickles)}: {NO_PICKLE}; "
            f"download {wanted} of the same model, or convert it on a machine you can lose"
        )
    raise InputError(f"{place} has no {wanted}: download it")


def _words(place: Path) -> Part:
    """A tokenizer, or a processor of pictures."""
    groups = PROCESSORS if place.name == "processor" else TOKENIZERS
    if any(all((place / file).is_file() for file in group) for group in groups):
        return Part(place.name)
    likely = PROCESSORS[0] if groups is PROCESSORS else TOKENIZERS[1]
    missing = [file for file in likely if not (place / file).is_file()]
    return Part(place.name, tuple(f"{place} has no {file}: download it" for file in missing))


def _checked_channels(folder: Path, unet: Part) -> Part:
    """The U-Net's part, with a problem more where it is shown no picture."""
    config, vae = _settings(folder / "unet" / "config.json"), _settings(folder / "vae/config.json")
    if config is None or vae is None:
        return unet
    shown, latent = config.get("in_channels", 4), vae.get("latent_channels", 4)
    if shown != 2 * latent:
        wrong = (
            f"{folder}: this is not an InstructPix2Pix model (its unet takes {shown} channels, "
            f"not {2 * latent}): one of that kind is timbrooks/instruct-pix2pix"
        )
        return replace(unet, problems=(wrong, *unet.problems))
    for file in unet.files:
        first = tensors(folder / file).get("conv_in.weight")
        if first is not None and first.shape[1:2] != (shown,):
            wrong = (
                f"{folder / file} takes {first.shape[1]} channels and its config.json says "
                f"{shown}: the two are of different models; download both again"
            )
            return replace(unet, problems=(*unet.problems, wrong))
    return unet


def _notes(folder: Path, kind: Kind, parts: Sequence[str]) -> tuple[str, ...]:
    beside = [path for place in (".", *parts) for path in sorted((folder / place).glob("*"))]
    pickles = [path.relative_to(folder).as_posix() for path in beside if path.suffix in PICKLES]
    notes = [f"{', '.join(pickles)}: left alone; {NO_PICKLE}"] if pickles else []
    if kind.family in (SD, SDXL) and not (folder / "scheduler" / CONFIGS["scheduler"]).is_file():
        notes.append("no scheduler/scheduler_config.json: Stable Diffusion's own schedule is used")
    return tuple(notes)


def _of_file(path: Path, settings: Path | None) -> Weights:
    """The contents of a single file. Raises InputError for a pickle, a file of another kind, and
    where there is no folder with its settings."""
    if path.suffix in PICKLES:
        raise InputError(
            f"{path} is a pickle: {NO_PICKLE}; give a folder in diffusers' layout, with unet/, "
            "vae/, text_encoder/ and tokenizer/"
        )
    file = read_single_file(path)
    folder = settings or settings_beside(path)
    if folder is None:
        raise InputError(
            f"{path} is a single file, without settings and tokenizer, and neither "
            f"{path.with_suffix('')} nor {path.parent} has them (unet/config.json): {file.advice()}"
        )
    scheduler = str(COSXL_SCHEDULER["_class_name"]) if file.is_cosxl else ""
    kind = Kind(file.family, file.family.pipelines[0], scheduler)
    parts = [_part_of_file(file, folder, c) for c in kind.family.components]
    is_xl = (_settings(folder / "unet/config.json") or {}).get("addition_embed_type") == "text_time"
    if is_xl != (file.family == SDXL):
        other = f"{folder} has the settings of another model than {path}: {file.advice()}"
        parts[0] = replace(parts[0], problems=(other, *parts[0].problems))
    used = tuple(part for part in parts if part.name != "scheduler")
    return Weights(folder, kind, used, file=file)


def _part_of_file(file: SingleFile, folder: Path, component: Component) -> Part:
    """A component of a single file, whose settings are in the folder."""
    if component.role not in ("network", "encoder"):
        return _words(folder / component.name)
    held, problems = file.of(component.name), ()
    try:
        config_of(folder / component.name / CONFIGS[component.role])
    except InputError as error:
        problems = (str(error),)
    size = sum(each.size for each in held)
    return Part(component.name, problems, (file.path.name,), size, None, main_dtype(held))
