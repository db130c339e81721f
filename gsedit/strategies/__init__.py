"""When to ask the 2D editor and when to fit the scene: one strategy a file, found by its name.

A strategy is a frozen dataclass: its fields are its settings (and options of `gsedit edit`), and
calling it with a Session runs it. The file `single_pass.py` holds `SinglePass`, whose name on the
command line is `single-pass`.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Iterator
from typing import TYPE_CHECKING, Protocol, runtime_checkable

from gsedit.errors import UsageError

if TYPE_CHECKING:
    from gsedit.reports.events import Checkpoint, Event
    from gsedit.session.session import Session

DEFAULT = "single-pass"


@runtime_checkable
class Strategy(Protocol):
    """Edits and fits until it is done."""

    def __call__(self, session: Session) -> Iterator[Event | Checkpoint]:
        """Yields what happens, and the scene whenever it is worth keeping."""
        ...


def strategy_names() -> tuple[str, ...]:
    """The strategies that there are; none of them is imported."""
    return tuple(sorted(m.name.replace("_", "-") for m in pkgutil.iter_modules(__path__)))


def find_strategy(name: str) -> type[Strategy]:
    """The dataclass of that name. Raises UsageError, with the names there are, for any other."""
    if name not in strategy_names():
        raise UsageError(
            f"there is no strategy {name!r}: choose one of {', '.join(strategy_names())}"
        )
    module = importlib.import_module(f"{__name__}.{name.replace('-', '_')}")
    return getattr(module, name.title().replace("-", ""))


def name_of(strategy: Strategy) -> str:
    """The name of a strategy, as on the command line."""
    return type(strategy).__module__.rpartition(".")[2].replace("_", "-")
