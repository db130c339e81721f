"""Mask providers by their names, those of this package and of others.

A package adds one by an entry point of the group `gsedit.masks`: a name, and a callable that makes
a MaskProvider. Its parameters are the options that it takes: `run`, `model` and `sam` are passed by
name where they were given.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from gsedit.errors import GseditError, UsageError
from gsedit.mask_protocol import MaskProvider

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
    from gsedit.masks.command import EXAMPLE, MaskCommand

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
        return import_module("gsedit.masks.networks")
    except ImportError as error:
        raise UsageError(
            f"masks by networks need {error.name}: pip install 'gsedit[diffusers]'"
        ) from error


BUILT_IN: dict[str, Factory] = {
    "command": _command,
    "clipseg": _clipseg,
    "grounded-sam": _grounded_sam,
}
