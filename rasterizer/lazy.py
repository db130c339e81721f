"""Packages that import their public names when they are first used: importing them is cheap."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from importlib import import_module
from types import ModuleType
from typing import Any


class LazyPackage(ModuleType):
    """A package whose public names, and whose modules, are imported when they are first used.

    A public name may be that of a module too (`gsedit.edit` is a function of gsedit/edit.py). The
    import system sets an imported module as an attribute of its package, which would hide the name:
    here the name wins. The module stays in `sys.modules`, where `from gsedit.edit import ...` finds
    it.
    """

    _homes: dict[str, str]
    """The module of each public name."""

    def __getattr__(self, name: str) -> Any:
        homes = self.__dict__["_homes"]
        if name in homes:
            return getattr(import_module(f"{self.__name__}.{homes[name]}"), name)
        module = f"{self.__name__}.{name}"
        if not name.startswith("_"):
            try:
                return import_module(module)
            except ModuleNotFoundError as error:
                if error.name != module:  # the module exists, and one that it imports does not
                    raise
        raise AttributeError(f"module {self.__name__!r} has no attribute {name!r}")

    def __setattr__(self, name: str, value: Any) -> None:
        if isinstance(value, ModuleType) and name in self._homes:
            value = getattr(value, name)
        super().__setattr__(name, value)

    def __dir__(self) -> list[str]:
        return sorted({*super().__dir__(), *self._homes})


def make_lazy(package: str, modules: Mapping[str, tuple[str, ...]]) -> None:
    """Make a package lazy; `modules` lists the names that each of its modules defines.

    Call it from the package's __init__.py, with `__name__`. Type checkers see the names if they are
    imported there under `if TYPE_CHECKING`.
    """
    module = sys.modules[package]
    vars(module)["_homes"] = {name: home for home, names in modules.items() for name in names}
    module.__class__ = LazyPackage
