"""Whether an InstructPix2Pix folder is complete, by names, configs and headers; no tensor is read.

The layout is diffusers': a folder a part, `config.json` and safetensors in it. A safetensors file
is 8 bytes (the header's length, little-endian), the header (JSON: name -> dtype, shape,
data_offsets) and the data; its size follows from its header, so that a download that was cut short
is seen before gigabytes are loaded (github.com/huggingface/safetensors, "Format").
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any, Literal

from gsedit.errors import InputError
from gsedit.storage.json_files import object_of, parse_json, read_json

Kind = Literal["SD", "SDXL"]

NETWORKS = {"unet": "diffusion_pytorch_model", "vae": "diffusion_pytorch_model"}
ENCODERS = {"text_encoder": "model"}
XL_ENCODERS = {**ENCODERS, "text_encoder_2": "model"}
"""Stem of the weights' file in each part."""
PICKLES = (".bin", ".ckpt", ".pt", ".pth")
VARIANT = "fp16"
"""The half-precision twin, `<stem>.fp16.safetensors`: taken where the full one is not there."""
WANTED = ("model_index.json", "*/*.json", "*/*.txt", "*/*.safetensors")
"""Files of a hub repository that are needed: no pickles, and no single-file copy at its root."""
DEFECTS = ("*.fp16.*", "*.non_ema.*", "safety_checker/*")
LFS_POINTER = b"version https://git-lfs"
LONGEST_HEADER = 100_000_000  # bytes; the limit of the safetensors library itself
NO_PICKLE = "a pickle runs whatever code is in it when it is opened, so gsedit opens none"


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


@dataclass(frozen=True)
class Weights:
    """The contents of a model's folder."""

    folder: Path
    kind: Kind | None
    """None where the unet's config cannot be read."""
    parts: tuple[Part, ...]
    notes: tuple[str, ...] = ()
    """Notes on harmless oddities of the folder."""

    @property
    def problems(self) -> tuple[str, ...]:
        """Those of all parts."""
        return tuple(chain.from_iterable(part.problems for part in self.parts))

    @property
    def complete(self) -> bool:
        """Whether it can be loaded."""
        return not self.problems

    def variant(self, part: str) -> str | None:
        """Variant of a part's weights: None (full precision) or `fp16`."""
        return next(each.variant for each in self.parts if each.name == part)

    def require(self) -> Weights:
        """Itself, if complete. Raises InputError with the first problem and the number of more."""
        if self.complete:
            return self
        first, *more = self.problems
        rest = f" (and {len(more)} more: gsedit doctor {self.folder} lists them)" if more else ""
        raise InputError(f"{first}{rest}")


def inspect(folder: str | Path) -> Weights:
    """Inspect a model's folder without loading it.

    Raises InputError where there is no such folder, or it is a single file.
    """
    folder = Path(folder).expanduser()
    if folder.is_file():
        raise InputError(_single_file(folder))
    if not folder.is_dir():
        raise InputError(f"{folder}: there is no such folder; give the folder that holds unet/")
    config = _json(folder / "unet" / "config.json")
    kind = _kind(config)
    encoders = XL_ENCODERS if kind == "SDXL" else ENCODERS
    parts = [_network(folder, name, stem) for name, stem in (NETWORKS | encoders).items()]
    parts += [_tokenizer(folder, name.replace("text_encoder", "tokenizer")) for name in encoders]
    parts[0] = _checked_channels(folder, parts[0], config)
    return Weights(folder, kind, tuple(parts), _notes(folder, [part.name for part in parts]))


def config_of(path: Path) -> dict[str, Any]:
    """The settings in a JSON file. Raises InputError."""
    config = _json(path)
    if isinstance(config, str):
        raise InputError(config)
    return config


def tensors(path: Path) -> dict[str, tuple[int, ...]]:
    """Shapes of the tensors of a safetensors file that is as long as its header says.

    Raises InputError for one that is cut short, a Git LFS pointer, or no safetensors at all.
    """
    again = "download it again"
    try:
        size = path.stat().st_size
        with path.open("rb") as file:
            start = file.read(8)
            if start + file.read(len(LFS_POINTER) - 8) == LFS_POINTER:
                raise InputError(f"{path} is a Git LFS pointer, not weights: run 'git lfs pull'")
            length = struct.unpack("<Q", start)[0] if len(start) == 8 else 0
            file.seek(8)
            cut = 8 + length > size
            header = b"" if cut or length > LONGEST_HEADER else file.read(length)
    except FileNotFoundError:
        raise InputError(f"{path} is missing: {again.removesuffix(' again')}") from None
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}): {again}") from error
    if size < 8 or (cut and length <= LONGEST_HEADER):
        raise InputError(f"{path} is cut short inside its header ({_bytes(size)}): {again}")
    try:
        entries = parse_json(header, path)
        entries.pop("__metadata__", None)
        shapes = {name: tuple(entry["shape"]) for name, entry in entries.items()}
        ends = [entry["data_offsets"][1] for entry in entries.values()]
    except (InputError, ValueError, TypeError, KeyError, AttributeError, IndexError):
        raise InputError(f"{path} is no safetensors file: {again}") from None
    whole = 8 + length + max(ends, default=0)
    if size != whole:
        raise InputError(
            f"{path} has {_bytes(size)} of the {_bytes(whole)} that its header names: {again}"
        )
    return shapes


def _kind(config: dict[str, Any] | str) -> Kind | None:
    if isinstance(config, str):
        return None
    return "SDXL" if config.get("addition_embed_type") == "text_time" else "SD"


def _json(path: Path) -> dict[str, Any] | str:
    """The settings in a file, or what is wrong with it."""
    if not path.exists():
        return f"{path} is missing: download the model again"
    try:
        return read_json(path, object_of({}), advice="download the model again")
    except InputError as error:
        return str(error)


def _network(folder: Path, name: str, stem: str) -> Part:
    """A part with a config and weights, in one file or in shards."""
    place = folder / name
    if not place.is_dir():
        return Part(name, (f"{folder} has no {name}/: download that folder of the model too",))
    config = _json(place / "config.json")
    problems = [config] if isinstance(config, str) else []
    for variant in (None, VARIANT):
        try:
            files = _weight_files(place, stem, variant)
        except InputError as error:
            return Part(name, (*problems, str(error)))
        if files:
            break
    else:
        return Part(name, (*problems, _no_weights(place, f"{stem}.safetensors")))
    whole = []
    for file in files:
        try:
            tensors(file)
            whole.append(file)
        except InputError as error:
            problems.append(str(error))
    names = tuple(str(file.relative_to(folder)) for file in whole)
    size = sum(file.stat().st_size for file in whole)
    return Part(name, tuple(problems), names, size, variant)


def _weight_files(place: Path, stem: str, variant: str | None) -> list[Path]:
    """The files that hold a part's weights; none if there are none of this variant."""
    dot = f".{variant}" if variant else ""
    single = place / f"{stem}{dot}.safetensors"
    if single.is_file():
        return [single]
    index = place / f"{stem}.safetensors.index{dot}.json"
    if not index.is_file():
        return []
    shards = config_of(index).get("weight_map")
    if not isinstance(shards, dict) or not shards:
        raise InputError(f"{index} names no files: download the model again")
    return [place / str(name) for name in sorted(set(shards.values()))]


def _no_weights(place: Path, wanted: str) -> str:
    pickles = sorted(path.name for path in place.iterdir() if path.suffix in PICKLES)
    if pickles:
        return (
            f"{place} has only {', '.join(pickles)}: {NO_PICKLE}; "
            f"download {wanted} of the same model, or convert it on a machine you can lose"
        )
    return f"{place} has no {wanted}: download it"


def _tokenizer(folder: Path, name: str) -> Part:
    place = folder / name
    if not place.is_dir():
        return Part(name, (f"{folder} has no {name}/: download that folder of the model too",))
    if (place / "tokenizer.json").is_file():
        return Part(name)
    missing = [file for file in ("vocab.json", "merges.txt") if not (place / file).is_file()]
    return Part(name, tuple(f"{place} has no {file}: download it" for file in missing))


def _checked_channels(folder: Path, unet: Part, config: dict[str, Any] | str) -> Part:
    """The unet's part, with a problem more where it is not one that is shown a picture."""
    vae = _json(folder / "vae" / "config.json")
    if isinstance(config, str) or isinstance(vae, str):
        return unet
    shown, latent = config.get("in_channels", 4), vae.get("latent_channels", 4)
    if shown != 2 * latent:
        wrong = (
            f"{folder}: this is not an InstructPix2Pix model (its unet takes {shown} channels, "
            f"not {2 * latent}): one of that kind is timbrooks/instruct-pix2pix"
        )
        return replace(unet, problems=(wrong, *unet.problems))
    for file in unet.files:
        shape = tensors(folder / file).get("conv_in.weight", ())
        if len(shape) == 4 and shape[1] != shown:
            wrong = (
                f"{folder / file} takes {shape[1]} channels and its config.json says {shown}: "
                "the two are of different models; download both again"
            )
            return replace(unet, problems=(*unet.problems, wrong))
    return unet


def _notes(folder: Path, parts: Sequence[str]) -> tuple[str, ...]:
    beside = [path for place in (".", *parts) for path in sorted((folder / place).glob("*"))]
    pickles = [str(path.relative_to(folder)) for path in beside if path.suffix in PICKLES]
    notes = [f"{', '.join(pickles)}: left alone; {NO_PICKLE}"] if pickles else []
    if not (folder / "scheduler" / "scheduler_config.json").is_file():
        notes.append("no scheduler/scheduler_config.json: Stable Diffusion's own schedule is used")
    return tuple(notes)


def _single_file(path: Path) -> str:
    layout = "a folder in diffusers' layout is needed, with unet/, vae/, text_encoder/, tokenizer/"
    if path.suffix in PICKLES:
        return f"{path} is a pickle: {NO_PICKLE}; {layout}"
    return (
        f"{path} is a single file: {layout} (diffusers makes one of it: "
        "StableDiffusionInstructPix2PixPipeline.from_single_file(FILE).save_pretrained(FOLDER))"
    )


def _bytes(count: int) -> str:
    """A size for a person; exact below a megabyte, where a few bytes can matter."""
    return f"{count:,} bytes" if count < 1_000_000 else f"{count / 1e6:,.1f} MB"
