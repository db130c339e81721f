"""Plugins by name: callables of this package and of others, with the options that they take.

A package adds one by an entry point of a table's group: a name, and a callable (a class, say). The
first line of its docstring is its summary, and its parameters are the options that it takes, passed
by name where they were given. It may have an attribute `missing`, a callable without arguments that
returns what is not installed, one line for each with its next move.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from gsedit.errors import GseditError, UsageError

Factory = Callable[..., Any]
Missing = Callable[[], Iterable[str]]
EXAMPLE = '--run "my_editor {input} {output} {prompt}"'
MASK_EXAMPLE = '--masks-run "my_segmenter {input} {output} {phrase}"'
"""Options that name a program of the user's."""
OFFERED = ("folder", "precision")
"""Options that are offered to every plugin, and taken by those that have them."""
UNLISTED = ("folder", "precision", "timeout")
"""Options that other parts of the command line give, or `--set` alone."""


@dataclass(frozen=True)
class Listing:
    """One plugin, as it is listed."""

    name: str
    summary: str
    """Summary in one line; empty where it cannot be imported."""
    source: str
    """The package it comes with."""
    options: tuple[str, ...]
    """Its options as on the command line: --model, --run, ..."""
    needs: tuple[str, ...]
    """Requirements that are missing before it can run, each with its next move."""

    @property
    def ready(self) -> bool:
        return not self.needs


@dataclass(frozen=True)
class Plugins:
    """A table of plugins of one kind: ours, and those that entry points of its group add."""

    group: str
    kind: str
    """Name of what is made, in messages: editor."""
    ours: Mapping[str, tuple[Factory, Missing]]
    parts: tuple[str, ...]
    """Attributes that everything that is made has."""
    prefix: str = "--"
    """Beginning of the options on the command line."""

    def make(self, name: str, options: Mapping[str, Any]) -> Any:
        """The product of a plugin; `options` that are None are as if they were not given.

        Raises UsageError for a name or an option that there is not, GseditError where another
        package's cannot be made.
        """
        if name not in self.names():
            raise UsageError(
                f"there is no {self.kind} {name!r}: choose one of {', '.join(self.names())} (see "
                f"gsedit list {self.group.rpartition('.')[2]})"
            )
        if name in self.ours:
            factory = self.ours[name][0]
            return factory(**self._taken(name, factory, options))
        entry = self._others()[name]
        try:
            factory = entry.load()
            made = factory(**self._taken(name, factory, options))
        except GseditError:
            raise
        except Exception as error:  # whatever a third party does
            raise self._fault(entry, f"cannot be made ({_reason(error)})") from error
        if lacks := [part for part in self.parts if not hasattr(made, part)]:
            raise self._fault(entry, f"is none: it has no {', no '.join(lacks)}")
        return made

    def names(self) -> tuple[str, ...]:
        """Every name that `make` takes, ours first."""
        return (*self.ours, *self._others())

    def list(self) -> tuple[Listing, ...]:
        """Every plugin with what it needs; so is what cannot be imported, and nothing is raised."""
        ours = [self._listing(name, *both, "gsedit") for name, both in self.ours.items()]
        return (*ours, *map(self._their_listing, self._entries()))

    def _taken(self, name: str, factory: Factory, options: Mapping[str, Any]) -> dict[str, Any]:
        """The given options. Raises UsageError for one that is not taken, with who takes it."""
        known, given = _parameters(factory), {}
        for key, value in options.items():
            if value is not None and key in known:
                given[key] = value
            elif value is not None and key not in OFFERED:
                others = [each for each, (own, _) in self.ours.items() if key in _parameters(own)]
                has = f"; {' or '.join(f'--{self.kind} {each}' for each in others)} has it"
                raise UsageError(
                    f"the {name} {self.kind} has no option {self._flag(key)}: it takes "
                    f"{', '.join(self._flags(factory)) or 'none'}{has * bool(others)}"
                )
        return given

    def _fault(self, entry: EntryPoint, what: str) -> GseditError:
        source = _source(entry)
        return GseditError(
            f"the {entry.name} {self.kind} ({source}) {what}: reinstall or remove {source}, or ask "
            "its authors"
        )

    def _entries(self) -> list[EntryPoint]:
        return sorted(entry_points(group=self.group), key=lambda entry: (entry.name, entry.value))

    def _others(self) -> dict[str, EntryPoint]:
        """The usable entry points by name: ours have precedence, then the first of a name."""
        entries = reversed(self._entries())
        return {entry.name: entry for entry in entries if entry.name not in self.ours}

    def _their_listing(self, entry: EntryPoint) -> Listing:
        source, first = _source(entry), self._others().get(entry.name)
        if first is None or first != entry:
            taken = f"another name: {entry.name!r} is taken; ask the authors of {source}"
            return Listing(entry.name, "", source, (), (taken,))
        try:
            factory = entry.load()
            return self._listing(entry.name, factory, getattr(factory, "missing", tuple), source)
        except Exception as error:  # a list that one package can break lists nothing
            return Listing(entry.name, "", source, (), (_reason(error),))

    def _listing(self, name: str, factory: Factory, missing: Missing, source: str) -> Listing:
        summary = (inspect.getdoc(factory) or "").split("\n")[0]
        return Listing(name, summary, source, self._flags(factory), tuple(missing()))

    def _flags(self, factory: Factory) -> tuple[str, ...]:
        return tuple(self._flag(key) for key in _parameters(factory) if key not in UNLISTED)

    def _flag(self, key: str) -> str:
        return f"{self.prefix}{key.replace('_', '-')}"


def _parameters(factory: Factory) -> tuple[str, ...]:
    spread = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
    parameters = inspect.signature(factory).parameters.values()
    return tuple(parameter.name for parameter in parameters if parameter.kind not in spread)


def _source(entry: EntryPoint) -> str:
    """The package that an entry point comes with."""
    return entry.dist.name if entry.dist else entry.value


def _reason(error: Exception) -> str:
    return " ".join(f"{type(error).__name__}: {error}".split())
