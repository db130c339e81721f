"""Which 2D editors there are, what each needs, and how one is made: ours, and those of others.

A package adds an editor by an entry point of the group `gsedit.editors`: a name, and a callable
(a class, say) that makes an Editor. Its docstring's first line is what it does. Its parameters are
the options that it takes, by name: of `model`, `weights_dir`, `run`, `timeout` and `folder`, those
that were given are handed over. If it has an attribute `missing`, a callable without arguments,
that names what is not installed, a line each with its next move. What is optional of an editor is
declared in its attribute `capabilities` (gsedit.editors.Capabilities).
`examples/write_an_editor.py` shows one.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any

from gsedit.editors.protocol import Editor
from gsedit.errors import GseditError, UsageError

GROUP = "gsedit.editors"
DEFAULT = "small"
OURS = "gsedit"
PARTS = ["name", "cell", "check", "edit", "capabilities"]
"""What every editor has."""

Factory = Callable[..., Editor]
Missing = Callable[[], Iterable[str]]


@dataclass(frozen=True)
class Listing:
    """One editor, as it is listed."""

    name: str
    summary: str
    """What it does, one line; empty where it cannot be imported."""
    source: str
    """The package it comes with."""
    options: tuple[str, ...]
    """What it can be told, as on the command line: --model, --run, ..."""
    needs: tuple[str, ...]
    """What is missing before it can run, each with its next move."""

    @property
    def ready(self) -> bool:
        return not self.needs


# ---- ours: each factory's docstring is its line in the list -------------------------------------


def _small(model: str | Path | None = None) -> Editor:
    """Learned, comes with gsedit: some fifty looks of subject and scene, in words of your own."""
    from gsedit.editors.sampling import DiffusionEditor
    from gsedit.editors.small import load_small

    return DiffusionEditor(load_small(None if model is None else Path(model).expanduser()))


def _small_missing() -> Iterable[str]:
    from gsedit.editors.small import REINSTALL, WEIGHTS

    if not WEIGHTS.exists():
        yield f"its weights: {REINSTALL}"


def _closed_form() -> Editor:
    """Built in, no weights: known looks with a known answer, to measure the method by."""
    from gsedit.editors.closed_form import ClosedForm
    from gsedit.editors.sampling import DiffusionEditor

    return DiffusionEditor(ClosedForm())


def _pix2pix(model: str | Path | None = None, weights_dir: str | Path | None = None) -> Editor:
    """InstructPix2Pix weights of Stable Diffusion 1.5 or SDXL, a folder or hub id: any sentence."""
    from gsedit.editors import pix2pix
    from gsedit.editors.sampling import DiffusionEditor

    denoiser = pix2pix.load_pix2pix(model or pix2pix.DEFAULT, weights_dir=weights_dir)
    return DiffusionEditor(denoiser)


def _pix2pix_missing() -> Iterable[str]:
    from importlib.util import find_spec

    from gsedit.editors import pix2pix
    from gsedit.editors.weights import inspect as inspect_weights

    absent = [name for name in ("diffusers", "transformers") if find_spec(name) is None]
    if absent:
        yield f"{' and '.join(absent)}: pip install 'gsedit[diffusers]'"
    try:
        whole = inspect_weights(pix2pix.find(pix2pix.DEFAULT, offline=True)).complete
    except GseditError:
        whole = False
    if not whole:
        yield (
            "weights: add --model FOLDER_OR_ID, or let the first use download "
            f"{pix2pix.DEFAULT}; {pix2pix.advice(pix2pix.DEFAULT)}"
        )


def _command(
    run: str | None = None, timeout: float | None = None, folder: Path | None = None
) -> Editor:
    """Any program that fills a folder of pictures from another; made consistent afterwards."""
    from gsedit.editors.command import EXAMPLE, Command

    if run is None:
        raise UsageError(f"the command editor needs to know the program: add {EXAMPLE}")
    return Command(run, timeout, folder)


def _command_missing() -> Iterable[str]:
    from gsedit.editors.command import EXAMPLE

    yield f"a program of yours: {EXAMPLE}"


BUILT_IN: dict[str, tuple[Factory, Missing]] = {
    "small": (_small, _small_missing),
    "closed-form": (_closed_form, tuple),
    "pix2pix": (_pix2pix, _pix2pix_missing),
    "command": (_command, _command_missing),
}
EDITORS = tuple(BUILT_IN)
"""The names of ours."""


# ---- everybody's ---------------------------------------------------------------------------------


def make_editor(name: str = DEFAULT, **options: Any) -> Editor:
    """The editor of that name; `options` that are None are as if they were not given.

    `model` is for small (a file, see load_small) and pix2pix, `weights_dir` for pix2pix (see
    load_pix2pix), `run`, `timeout` (seconds) and `folder` for command (see Command). Raises
    UsageError for a name or an option that there is not, GseditError where a third party's editor
    cannot be made.
    """
    factory, source = _factory(name)
    takes = _parameters(factory)
    given = {key: value for key, value in options.items() if value is not None}
    if "folder" not in takes:  # offered to whoever wants one, asked for by nobody
        given.pop("folder", None)
    for key in given:
        if key not in takes:
            told = f"it takes {', '.join(_flags(factory))}" if takes else "it takes none"
            able = [other for other in BUILT_IN if key in _parameters(BUILT_IN[other][0])]
            hint = f"; {' or '.join(f'--editor {other}' for other in able)} has it" if able else ""
            raise UsageError(f"the {name} editor has no option {_flag(key)}: {told}{hint}")
    if source == OURS:
        return factory(**given)
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
    """Every editor that can be asked for, ours first."""
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
        raise UsageError(f"there is no editor {name!r}: choose one of {names} (see gsedit editors)")
    found, source = others[name], _source(others[name])
    try:
        factory: Factory = found.load()
    except Exception as error:  # importing runs their code
        raise GseditError(
            f"the {name} editor ({source}) cannot be imported ({_reason(error)}): "
            f"reinstall or remove {source}"
        ) from error
    if not callable(factory):
        raise GseditError(f"the {name} editor ({source}) is no callable: {found.value}")
    return factory, source


def _all_others() -> list[EntryPoint]:
    return sorted(entry_points(group=GROUP), key=lambda found: (found.name, found.value))


def _others() -> dict[str, EntryPoint]:
    """The entry points that can be asked for: ours have the right of way, then the first."""
    named: dict[str, EntryPoint] = {}
    for found in _all_others():
        if found.name not in BUILT_IN:
            named.setdefault(found.name, found)
    return named


def _their_listing(found: EntryPoint) -> Listing:
    source = _source(found)
    first = _others().get(found.name)
    if first is None or first != found:
        taken = f"another name: {found.name!r} is taken; ask the authors of {source}"
        return Listing(found.name, "", source, (), (taken,))
    try:
        factory, _ = _factory(found.name)
        return _listing(found.name, factory, getattr(factory, "missing", tuple), source)
    except Exception as error:  # a list that one package can break lists nothing
        return Listing(found.name, "", source, (), (_reason(error),))


def _listing(name: str, factory: Factory, missing: Missing, source: str) -> Listing:
    summary = (inspect.getdoc(factory) or "").split("\n")[0]
    return Listing(name, summary, source, _flags(factory), tuple(missing()))


def _parameters(factory: Factory) -> tuple[str, ...]:
    spread = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
    taken = inspect.signature(factory).parameters.values()
    return tuple(parameter.name for parameter in taken if parameter.kind not in spread)


def _flags(factory: Factory) -> tuple[str, ...]:
    return tuple(_flag(key) for key in _parameters(factory) if key != "folder")


def _flag(key: str) -> str:
    return f"--{key.replace('_', '-')}"


def _source(found: EntryPoint) -> str:
    return found.dist.name if found.dist else found.value


def _reason(error: Exception) -> str:
    if isinstance(error, GseditError):
        return str(error)
    return " ".join(f"{type(error).__name__}: {error}".split())
