"""Packages that import their public names when they are first used: importing them is cheap."""

from __future__ import annotations

import ast
import sys
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any


class LazyPackage(ModuleType):
    """A package whose public names, and whose modules, are imported when they are first used.

    A public name may be that of a module too (`rasterizer.render` is a function of render.py). The
    import system sets an imported module as an attribute of its package, which would hide the name:
    here the name wins. The module stays in `sys.modules`, where its full name finds it.
    """

    _homes: dict[str, str]
    """The module of each public name."""

    def __getattr__(self, name: str) -> Any:
        homes = self.__dict__["_homes"]
        if name in homes:
            return getattr(import_module(homes[name]), name)
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


def make_lazy(package: str) -> None:
    """Make a package lazy; its public names are those that it imports under `if TYPE_CHECKING`.

    Call it from the package's __init__.py, with `__name__`.
    """
    module = sys.modules[package]
    code = ast.parse(Path(str(module.__file__)).read_text("utf-8"))
    (block,) = (each for each in code.body if isinstance(each, ast.If))
    imports = [each for each in block.body if isinstance(each, ast.ImportFrom)]
    homes = {alias.name: str(each.module) for each in imports for alias in each.names}
    vars(module).update(_homes=homes, __all__=sorted(homes))
    module.__class__ = LazyPackage
