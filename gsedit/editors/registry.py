"""Registry of 2D editors, those of this package and of others: what each needs, how it is made.

A package adds an editor by an entry point of the group `gsedit.editors`: a name, and a callable
(a class, say) that makes an Editor. The first line of its docstring is the editor's summary. Its
parameters are the options that it takes: `model`, `weights_dir`, `runtime`, `decoder`, `run`,
`timeout` and `folder` are passed by name where they were given. It may have an attribute `missing`,
a callable without arguments that returns what is not installed, one line for each with its next
move. The editor's attribute `capabilities` (gsedit.editors.Capabilities) declares everything
optional.
`examples/write_an_editor.py` shows one. Listing the editors loads no torch.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gsedit.errors import GseditError, UsageError

if TYPE_CHECKING:
    from gsedit.diffusion.settings import Precision
    from gsedit.editor_protocol import Editor
    from gsedit.models.hub import Consent

GROUP = "gsedit.editors"
DEFAULT = "small"
OURS = "gsedit"
OFFERED = ("folder", "precision", "yes")
"""Options that are offered to every editor, and taken by those that have them."""
PARTS = ["name", "cell", "check", "edit", "capabilities"]
"""Attributes that every editor has."""

Factory = Callable[..., "Editor"]
Missing = Callable[[], Iterable[str]]


@dataclass(frozen=True)
class Listing:
    """One editor, as it is listed."""

    name: str
    summary: str
    """Summary of the editor, one line; empty where it cannot be imported."""
    source: str
    """The package it comes with."""
    options: tuple[str, ...]
    """Its options as on the command line: --model, --run, ..."""
    needs: tuple[str, ...]
    """Requirements that are missing before it can run, each with its next move."""

    @property
    def ready(self) -> bool:
        return not self.needs


# ---- ours: each factory's docstring is its line in the list -------------------------------------


def _small() -> Editor:
    """Learned, comes with gsedit: some fifty looks of subject and scene."""
    from gsedit.editors.small.editor import SmallEditor, load_small

    return SmallEditor(load_small())


def _small_missing() -> Iterable[str]:
    from gsedit.editors.small import REINSTALL, WEIGHTS

    if not WEIGHTS.exists():
        yield f"its weights: {REINSTALL}"


def _closed_form() -> Editor:
    """Built in, no weights: fixed looks with a known ground truth, to measure the method by."""
    from gsedit.editors.closed_form import ClosedForm
    from gsedit.editors.sampling import DiffusionEditor

    return DiffusionEditor(ClosedForm())


def _pix2pix(
    model: str | Path | None = None,
    weights_dir: str | Path | None = None,
    precision: Precision = "auto",
    yes: Consent = False,
    runtime: str = "auto",
    decoder: str | Path | None = None,
) -> Editor:
    """InstructPix2Pix, by default the authors' weights of Stable Diffusion 1.5: any sentence."""
    from gsedit.models.hub import DEFAULT as DEFAULT_MODEL

    return _diffusers(model or DEFAULT_MODEL, weights_dir, precision, yes, runtime, decoder)


def _diffusers(
    model: str | Path | None = None,
    weights_dir: str | Path | None = None,
    precision: Precision = "auto",
    yes: Consent = False,
    runtime: str = "auto",
    decoder: str | Path | None = None,
) -> Editor:
    """2D editing models in diffusers' layout, a folder or hub id: any sentence."""
    from gsedit.editors.sampling import DiffusionEditor
    from gsedit.models.loading import load_model
    from gsedit.models.runtimes import make_runtime
    from gsedit.models.small_decoder import with_small_decoder

    if model is None:
        raise UsageError(f"the diffusers editor needs a model: add {_models()}")
    run = make_runtime(runtime)
    loaded = load_model(model, weights_dir=weights_dir, precision=precision, yes=yes)
    if decoder is not None:
        loaded = with_small_decoder(loaded, decoder)
    return DiffusionEditor(replace(loaded, run=run))


def _models() -> str:
    """The option, with a model of every family."""
    from gsedit.models.families import FAMILIES

    examples = ", ".join(f"{each.example} ({each.gigabytes:.0f} GB)" for each in FAMILIES)
    return f"--model FOLDER_OR_ID, such as {examples}"


def _libraries_missing() -> Iterable[str]:
    from importlib.util import find_spec

    needed = ("accelerate", "diffusers", "transformers")
    absent = [name for name in needed if find_spec(name) is None]
    if absent:
        yield f"{', '.join(absent)}: pip install 'gsedit[diffusers]'"


def _diffusers_missing() -> Iterable[str]:
    yield from _libraries_missing()
    yield f"a model: add {_models()}"


def _pix2pix_missing() -> Iterable[str]:
    from gsedit.models import hub
    from gsedit.models.weights import inspect as inspect_weights

    yield from _libraries_missing()
    try:
        complete = inspect_weights(hub.find(hub.DEFAULT, offline=True)).complete
    except GseditError:
        complete = False
    if not complete:
        yield (
            "weights: add --model FOLDER_OR_ID, or let the first use download "
            f"{hub.DEFAULT} with --yes; {hub.download_advice(hub.DEFAULT)}"
        )


def _command(
    run: str | None = None, timeout: float | None = None, folder: Path | None = None
) -> Editor:
    """Any program that reads a folder of pictures and fills another; made consistent afterwards."""
    from gsedit.editors.command.editor import Command
    from gsedit.editors.command.program import EXAMPLE

    if run is None:
        raise UsageError(f"the command editor needs to know the program: add {EXAMPLE}")
    return Command(run, timeout, folder)


def _command_missing() -> Iterable[str]:
    from gsedit.editors.command.program import EXAMPLE

    yield f"a program of yours: {EXAMPLE}"


BUILT_IN: dict[str, tuple[Factory, Missing]] = {
    "small": (_small, _small_missing),
    "closed-form": (_closed_form, tuple),
    "pix2pix": (_pix2pix, _pix2pix_missing),
    "diffusers": (_diffusers, _diffusers_missing),
    "command": (_command, _command_missing),
}
EDITORS = tuple(BUILT_IN)
"""The names of ours."""


# ---- ours and those of others -------------------------------------------------------------------


def make_editor(name: str = DEFAULT, **options: Any) -> Editor:
    """The editor of that name; `options` that are None are as if they were not given.

    `model`, `weights_dir`, `precision`, `yes`, `runtime`, `decoder` are for pix2pix and diffusers
    (see load_model), `run`, `timeout` (seconds) and `folder` for command (see Command). Raises
    UsageError for a name or an option that there is not, GseditError where a third party's editor
    cannot be made.
    """
    factory, source = _factory(name)
    parameters = _parameters(factory)
    given = {key: value for key, value in options.items() if value is not None}
    for key in OFFERED:
        if key not in parameters:
            given.pop(key, None)
    for key in given:
        if key not in parameters:
            raise UsageError(f"the {name} editor has no option {_flag(key)}: {_hint(key, factory)}")
    if source == OURS:
        return factory(**given)
    return _made_by_others(name, source, factory, given)


def _hint(key: str, factory: Factory) -> str:
    """Hint after a wrong option: the options of this editor, and the editors that take this one."""
    flags = _flags(factory)
    takes = f"it takes {', '.join(flags)}" if flags else "it takes none"
    others = [name for name, (other, _) in BUILT_IN.items() if key in _parameters(other)]
    if not others:
        return takes
    return f"{takes}; {' or '.join(f'--editor {name}' for name in others)} has it"


def _made_by_others(name: str, source: str, factory: Factory, given: dict[str, Any]) -> Editor:
    """An editor of another package. Raises GseditError where it fails or is incomplete."""
    try:
        editor = factory(**given)
    except GseditError:
        raise
    except Exception as error:  # whatever a third party does
        raise GseditError(
            f"the {name} editor ({source}) cannot be made ({_reason(error)}): "
            f"ask the authors of {source}"
        ) from error
    missing = [part for part in PARTS if not hasattr(editor, part)]
    if missing:
        hint = " (gsedit.editors.Capabilities() declares none)" if missing == PARTS[-1:] else ""
        raise GseditError(
            f"what {source} makes as {name} is no editor: it has no {', no '.join(missing)}{hint}; "
            f"ask the authors of {source}"
        )
    return editor


def editor_names() -> tuple[str, ...]:
    """Every editor that `make_editor` takes, ours first."""
    return (*BUILT_IN, *_others())


def list_editors() -> tuple[Listing, ...]:
    """Every editor with what it needs. What cannot be imported is listed too; nothing is raised."""
    ours = [_listing(name, *BUILT_IN[name], OURS) for name in BUILT_IN]
    return (*ours, *map(_their_listing, _all_others()))


def _factory(name: str) -> tuple[Factory, str]:
    """(what makes that editor, the package it comes with)."""
    if name in BUILT_IN:
        return BUILT_IN[name][0], OURS
    others = _others()
    if name not in others:
        names = ", ".join(editor_names())
        raise UsageError(
            f"there is no editor {name!r}: choose one of {names} (see gsedit list editors)"
        )
    entry, source = others[name], _source(others[name])
    try:
        factory: Factory = entry.load()
    except Exception as error:  # importing runs their code
        raise GseditError(
            f"the {name} editor ({source}) cannot be imported ({_reason(error)}): "
            f"reinstall or remove {source}"
        ) from error
    if not callable(factory):
        raise GseditError(f"the {name} editor ({source}) is no callable: {entry.value}")
    return factory, source


def _all_others() -> list[EntryPoint]:
    return sorted(entry_points(group=GROUP), key=lambda entry: (entry.name, entry.value))


def _others() -> dict[str, EntryPoint]:
    """The usable entry points by name: ours have precedence, then the first of a name."""
    named: dict[str, EntryPoint] = {}
    for entry in _all_others():
        if entry.name not in BUILT_IN:
            named.setdefault(entry.name, entry)
    return named


def _their_listing(entry: EntryPoint) -> Listing:
    source = _source(entry)
    first = _others().get(entry.name)
    if first is None or first != entry:
        taken = f"another name: {entry.name!r} is taken; ask the authors of {source}"
        return Listing(entry.name, "", source, (), (taken,))
    try:
        factory, _ = _factory(entry.name)
        return _listing(entry.name, factory, getattr(factory, "missing", tuple), source)
    except Exception as error:  # a list that one package can break lists nothing
        return Listing(entry.name, "", source, (), (_reason(error),))


def _listing(name: str, factory: Factory, missing: Missing, source: str) -> Listing:
    summary = (inspect.getdoc(factory) or "").split("\n")[0]
    return Listing(name, summary, source, _flags(factory), tuple(missing()))


def _parameters(factory: Factory) -> tuple[str, ...]:
    spread = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
    parameters = inspect.signature(factory).parameters.values()
    return tuple(parameter.name for parameter in parameters if parameter.kind not in spread)


def _flags(factory: Factory) -> tuple[str, ...]:
    return tuple(_flag(key) for key in _parameters(factory) if key not in ("folder", "precision"))


def _flag(key: str) -> str:
    return f"--{key.replace('_', '-')}"


def _source(entry: EntryPoint) -> str:
    """The package that an entry point comes with."""
    return entry.dist.name if entry.dist else entry.value


def _reason(error: Exception) -> str:
    if isinstance(error, GseditError):
        return str(error)
    return " ".join(f"{type(error).__name__}: {error}".split())
