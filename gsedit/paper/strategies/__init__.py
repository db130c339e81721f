"""Strategies, one a file, found by name: when views are edited and when the scene is fitted.

A strategy is a frozen dataclass: its fields are its settings (and options of `gsedit edit`), and
its `schedule` says what is done, in order. The file `single_pass.py` holds `SinglePass`, whose name
on the command line is `single-pass`. Files whose name begins with an underscore are no strategies.
"""

from __future__ import annotations

import importlib
import pkgutil
from dataclasses import is_dataclass
from typing import TYPE_CHECKING, cast

from gsedit.errors import GseditError, UsageError

if TYPE_CHECKING:
    from gsedit.paper.actions import Strategy

DEFAULT = "single-pass"


def strategy_names() -> tuple[str, ...]:
    """The names of all strategies; none of them is imported."""
    files = (module.name for module in pkgutil.iter_modules(__path__))
    return tuple(sorted(name.replace("_", "-") for name in files if not name.startswith("_")))


def find_strategy(name: str) -> type[Strategy]:
    """Find the dataclass of the strategy of that name.

    Raises UsageError, with the names there are, for any other; GseditError where the file of that
    name does not hold it.
    """
    if name not in strategy_names():
        raise UsageError(
            f"there is no strategy {name!r}: choose one of {', '.join(strategy_names())}"
        )
    module = importlib.import_module(f"{__name__}.{name.replace('-', '_')}")
    class_name = "".join(word[:1].upper() + word[1:] for word in name.split("-"))
    found = getattr(module, class_name, None)
    if not is_dataclass(found):
        raise GseditError(f"{module.__file__} holds no dataclass {class_name}: name it so")
    return cast("type[Strategy]", found)
