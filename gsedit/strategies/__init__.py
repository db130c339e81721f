"""When views are edited and when the scene is fitted: one strategy a file, found by its name.

A strategy is a frozen dataclass: its fields are its settings (and options of `gsedit edit`), and
its `schedule` says what is done, in order. The file `single_pass.py` holds `SinglePass`, whose name
on the command line is `single-pass`. Files whose name begins with an underscore are no strategies.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Iterator
from dataclasses import is_dataclass
from typing import TYPE_CHECKING, Protocol, cast, runtime_checkable

from gsedit.errors import GseditError, UsageError

if TYPE_CHECKING:
    from gsedit.session.actions import Action
    from gsedit.session.session import Session

DEFAULT = "single-pass"


@runtime_checkable
class Strategy(Protocol):
    """What is edited and fitted, in order.

    It may have `check`, which raises UsageError or InputError before any work for what it lacks,
    and class attributes: `asks_editor`, False where it needs no 2D editor, and `fits_pictures`,
    False where it renders the optimiser's scene itself.
    """

    def schedule(self, session: Session) -> Iterator[Action]:
        """The actions of an edit, see gsedit.session.actions.

        They depend on the settings and on the plan of views, never on chance or on what an action
        found: an edit that is resumed skips those that are done. Chance belongs into the actions,
        from the generator of the request.
        """
        ...


def strategy_names() -> tuple[str, ...]:
    """The strategies that there are; none of them is imported."""
    files = (module.name for module in pkgutil.iter_modules(__path__))
    return tuple(sorted(name.replace("_", "-") for name in files if not name.startswith("_")))


def find_strategy(name: str) -> type[Strategy]:
    """The dataclass of that name.

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


def check_strategy(strategy: Strategy) -> None:
    """Raise UsageError or InputError where the strategy lacks something, such as weights."""
    check = getattr(strategy, "check", None)
    if check is not None:
        check()


def asks_editor(strategy: Strategy) -> bool:
    """Whether a 2D editor must be able to follow the instruction."""
    return getattr(strategy, "asks_editor", True)


def fits_pictures(strategy: Strategy) -> bool:
    """Whether it fits the scene to edited pictures alone; others render the optimiser's scene."""
    return getattr(strategy, "fits_pictures", True)


def uses_all_views(strategy: Strategy) -> bool:
    """Whether it edits or renders views that are not in the plan."""
    return getattr(strategy, "dataset_views", "planned") == "all"


def name_of(strategy: Strategy) -> str:
    """The name of a strategy, as on the command line."""
    return type(strategy).__module__.rpartition(".")[2].replace("_", "-")
