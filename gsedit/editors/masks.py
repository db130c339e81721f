"""Mask providers: programs and networks that find what a phrase names in pictures, by name.

A package adds one by an entry point of the group `gsedit.masks`: a name, and a callable that makes
a MaskProvider. Its parameters are the options that it takes: `run`, `model` and `sam` are passed by
name where they were given.
"""

from __future__ import annotations

import inspect
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from jaxtyping import Float
from torch import Tensor

from gsedit.editors.command.exchange import new_exchange, remove_exchange, run_in
from gsedit.editors.command.program import check_program, fill_fields, split_command
from gsedit.errors import GseditError, UsageError
from gsedit.select.masked import MaskProvider, read_mask

GROUP = "gsedit.masks"
Factory = Callable[..., MaskProvider]


def make_masks(name: str, **options: Any) -> MaskProvider:
    """The provider of that name; `options` that are None are as if they were not given.

    `run` is the program of command (see MaskCommand), `model` the folder of clipseg, and of the
    detector of grounded-sam, whose `sam` is that of SAM. Raises UsageError for a name or an option
    that there is not, GseditError where a third party's provider cannot be made.
    """
    factory = _factory(name)
    given = {key: value for key, value in options.items() if value is not None}
    known = inspect.signature(factory).parameters
    for key in given:
        if key not in known:
            raise UsageError(f"the masks {name!r} take no --masks-{key}")
    try:
        provider = factory(**given)
    except GseditError:
        raise
    except Exception as error:  # a third party's code
        raise GseditError(f"the masks {name!r} cannot be made: {error}") from error
    if not isinstance(provider, MaskProvider):
        raise GseditError(f"the masks {name!r} lack name, check or masks: ask their authors")
    return provider


def mask_names() -> tuple[str, ...]:
    """Every name that `make_masks` takes, ours first."""
    return (*BUILT_IN, *(each.name for each in _others()))


def list_masks() -> tuple[tuple[str, str], ...]:
    """Every name with what it is and takes, in a line; nothing is imported or raised."""
    others = (
        (each.name, f"from {each.dist.name if each.dist else each.value}") for each in _others()
    )
    return (*((name, str(make.__doc__)) for name, make in BUILT_IN.items()), *others)


def _factory(name: str) -> Factory:
    if name in BUILT_IN:
        return BUILT_IN[name]
    for entry in _others():
        if entry.name == name:
            try:
                return entry.load()
            except Exception as error:  # importing runs their code
                raise GseditError(f"the masks {name!r} cannot be imported: {error}") from error
    raise UsageError(f"there are no masks {name!r}: choose one of {', '.join(mask_names())}")


def _others() -> list[EntryPoint]:
    found = sorted(entry_points(group=GROUP), key=lambda entry: (entry.name, entry.value))
    return [entry for entry in found if entry.name not in BUILT_IN]


def _command(run: str | None = None) -> MaskProvider:
    """A program of yours: --masks-run "my_segmenter {input} {output} {phrase}"."""
    from gsedit.editors.masks import EXAMPLE, MaskCommand

    if run is None:
        raise UsageError(f"--masks command needs to know the program: add {EXAMPLE}")
    return MaskCommand(run)


def _clipseg(model: str | None = None) -> MaskProvider:
    """CLIPSeg, soft masks: --masks-model FOLDER; gsedit[diffusers]."""
    if model is None:
        raise UsageError("--masks clipseg needs its weights: add --masks-model FOLDER")
    return _networks().load_clipseg(model)


def _grounded_sam(model: str | None = None, sam: str | None = None) -> MaskProvider:
    """GroundingDINO and SAM: --masks-model FOLDER, --masks-sam FOLDER; gsedit[diffusers]."""
    if model is None or sam is None:
        raise UsageError(
            "--masks grounded-sam needs GroundingDINO and SAM: add --masks-model FOLDER and "
            "--masks-sam FOLDER"
        )
    return _networks().load_grounded_sam(model, sam)


def _networks() -> Any:
    """The module of networks. Raises UsageError without transformers."""
    try:
        import_module("transformers")
        return import_module("gsedit.models.mask_networks")
    except ImportError as error:
        raise UsageError(
            f"masks by networks need {error.name}: pip install 'gsedit[diffusers]'"
        ) from error


BUILT_IN: dict[str, Factory] = {
    "command": _command,
    "clipseg": _clipseg,
    "grounded-sam": _grounded_sam,
}

FIELDS = ("input", "output", "phrase", "python")
OPTION = "--masks-run"
EXAMPLE = f'{OPTION} "my_segmenter {{input}} {{output}} {{phrase}}"'


@dataclass(frozen=True, eq=False)
class MaskCommand:
    """A MaskProvider that runs a program once for all pictures. Raises UsageError."""

    run: str
    """The command, as for a shell, with {input} (the folder of pictures, PNG) and {output} (the
    folder to fill with masks of the same names: white where it is, black or transparent elsewhere,
    of any size of the same shape) in it. Optional: {phrase}; {python}, the interpreter that runs
    gsedit."""
    name: str = "command"

    def __post_init__(self) -> None:
        split_command(self.run, FIELDS, EXAMPLE)

    def check(self, phrase: str) -> None:
        """Raise UsageError without such a program, or for a phrase it cannot be given."""
        if "\0" in phrase:
            raise UsageError("the phrase has a NUL character in it, which no program is given")
        check_program(split_command(self.run, FIELDS, EXAMPLE)[0], OPTION)

    def masks(
        self, pictures: Sequence[Float[Tensor, "_ _ 3"]], phrase: str
    ) -> Iterator[Float[Tensor, "_ _"]]:
        """Yield a mask a picture; none is yielded before the program has ended.

        Raises UsageError where it cannot be started, GseditError where it fails, InputError for a
        mask that it left out or made of another shape; each says where its folders remain.
        """
        exchange = new_exchange(None, [f"{view:03d}.png" for view in range(len(pictures))])
        exchange.write("input", pictures)
        values = {"input": str(exchange.input), "output": str(exchange.output)}
        values |= {"phrase": phrase, "python": sys.executable}
        words = fill_fields(split_command(self.run, FIELDS, EXAMPLE), values)
        for _ in run_in(exchange, words):
            pass
        sizes = [(picture.shape[1], picture.shape[0]) for picture in pictures]
        made = [read_mask(exchange.made(n), *size) for n, size in zip(exchange.names, sizes)]
        remove_exchange(exchange, None)
        yield from made
