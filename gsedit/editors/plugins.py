"""Plugins by name: callables of this package and of others, with the options that they take.

A package adds one by an entry point of a table's group: a name, and a callable (a class, say). The
first line of its docstring is its summary, and its parameters are the options that it takes, passed
by name where they were given. It may have an attribute `missing`, a callable without arguments that
returns what is not installed, one line for each with its next move.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from gsedit.errors import GseditError, UsageError

Factory = Callable[..., Any]
Missing = Callable[[], Iterable[str]]
OURS = "gsedit"
INTERNAL = ("folder", "precision")
"""Parameters that are no options of the plugin's own on the command line."""


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
    """Kind of what is made, as in "the closed-form editor"."""
    ours: Mapping[str, tuple[Factory, Missing]]
    parts: Sequence[str]
    """Attributes that everything that is made has."""
    prefix: str = "--"
    """Beginning of its options on the command line."""
    offered: Sequence[str] = ()
    """Options that are offered to every one, and taken by those that have them."""
    hint: str = ""
    """Where a person reads more."""

    def make(self, name: str, options: Mapping[str, Any]) -> Any:
        """The plugin's product; `options` that are None are as if they were not given.

        Raises UsageError for a name or an option that there is not, GseditError where another
        package's cannot be made.
        """
        factory, source = self._factory(name)
        taken = _parameters(factory)
        given = {key: value for key, value in options.items() if value is not None}
        given = {
            key: each for key, each in given.items() if key in taken or key not in self.offered
        }
        for key in given:
            if key not in taken:
                flag = self._flag(key)
                raise UsageError(
                    f"the {name} {self.kind} has no option {flag}: {self._hint(key, factory)}"
                )
        if source == OURS:
            return factory(**given)
        try:
            made = factory(**given)
        except GseditError:
            raise
        except Exception as error:  # whatever a third party does
            raise GseditError(
                f"the {name} {self.kind} ({source}) cannot be made ({_reason(error)}): "
                f"ask the authors of {source}"
            ) from error
        if lacks := [part for part in self.parts if not hasattr(made, part)]:
            raise GseditError(
                f"what {source} makes as {name} is no {self.kind}: it has no "
                f"{', no '.join(lacks)}; ask the authors of {source}"
            )
        return made

    def names(self) -> tuple[str, ...]:
        """Every name that `make` takes, ours first."""
        return (*self.ours, *self._others())

    def list(self) -> tuple[Listing, ...]:
        """Every one with what it needs; so is what cannot be imported, and nothing is raised."""
        ours = [self._listing(name, *both, OURS) for name, both in self.ours.items()]
        return (*ours, *map(self._their_listing, self._entries()))

    def _factory(self, name: str) -> tuple[Factory, str]:
        """(what makes it, the package it comes with)."""
        if name in self.ours:
            return self.ours[name][0], OURS
        entry = self._others().get(name)
        if entry is None:
            names = ", ".join(self.names())
            raise UsageError(f"there is no {self.kind} {name!r}: choose one of {names}{self.hint}")
        source = _source(entry)
        try:
            factory: Factory = entry.load()
        except Exception as error:  # importing runs their code
            raise GseditError(
                f"the {name} {self.kind} ({source}) cannot be imported ({_reason(error)}): "
                f"reinstall or remove {source}"
            ) from error
        if not callable(factory):
            raise GseditError(f"the {name} {self.kind} ({source}) is no callable: {entry.value}")
        return factory, source

    def _hint(self, key: str, factory: Factory) -> str:
        """Hint after a wrong option: the options that are taken, and who takes this one."""
        flags = self._flags(factory)
        takes = f"it takes {', '.join(flags)}" if flags else "it takes none"
        others = [name for name, (other, _) in self.ours.items() if key in _parameters(other)]
        return f"{takes}; {' or '.join(others)} has it" if others else takes

    def _entries(self) -> list[EntryPoint]:
        return sorted(entry_points(group=self.group), key=lambda entry: (entry.name, entry.value))

    def _others(self) -> dict[str, EntryPoint]:
        """The usable entry points by name: ours have precedence, then the first of a name."""
        named: dict[str, EntryPoint] = {}
        for entry in self._entries():
            if entry.name not in self.ours:
                named.setdefault(entry.name, entry)
        return named

    def _their_listing(self, entry: EntryPoint) -> Listing:
        source = _source(entry)
        first = self._others().get(entry.name)
        if first is None or first != entry:
            taken = f"another name: {entry.name!r} is taken; ask the authors of {source}"
            return Listing(entry.name, "", source, (), (taken,))
        try:
            factory, _ = self._factory(entry.name)
            return self._listing(entry.name, factory, getattr(factory, "missing", tuple), source)
        except Exception as error:  # a list that one package can break lists nothing
            return Listing(entry.name, "", source, (), (_reason(error),))

    def _listing(self, name: str, factory: Factory, missing: Missing, source: str) -> Listing:
        summary = (inspect.getdoc(factory) or "").split("\n")[0]
        return Listing(name, summary, source, self._flags(factory), tuple(missing()))

    def _flags(self, factory: Factory) -> tuple[str, ...]:
        return tuple(self._flag(key) for key in _parameters(factory) if key not in INTERNAL)

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
    if isinstance(error, GseditError):
        return str(error)
    return " ".join(f"{type(error).__name__}: {error}".split())
