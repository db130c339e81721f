"""Edit captured 3D scenes (3D Gaussian splats) from a sentence, on a machine without a GPU.

Each name is imported when it is first used: `import gsedit.errors` loads no torch.
"""

from __future__ import annotations

import sys
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gsedit.edit import edit, edit_steps
    from gsedit.errors import GseditError, InputError, UsageError
    from gsedit.files import load, load_dataset, save
    from gsedit.fitting.fit import FitResult, fit, fit_steps
    from gsedit.fitting.settings import FitSettings
    from gsedit.reports.events import Checkpoint, Event
    from gsedit.session.folder import write_edit
    from gsedit.session.result import EditResult
    from gsedit.session.settings import EditSettings
    from gsedit.views.dataset import Dataset, View
    from gsedit.views.orbit import orbit

__all__ = [
    "Checkpoint",
    "Dataset",
    "EditResult",
    "EditSettings",
    "Event",
    "FitResult",
    "FitSettings",
    "GseditError",
    "InputError",
    "UsageError",
    "View",
    "edit",
    "edit_steps",
    "fit",
    "fit_steps",
    "load",
    "load_dataset",
    "orbit",
    "save",
    "write_edit",
]

_HOMES = {
    "Checkpoint": "reports.events",
    "Dataset": "views.dataset",
    "EditResult": "session.result",
    "EditSettings": "session.settings",
    "Event": "reports.events",
    "FitResult": "fitting.fit",
    "FitSettings": "fitting.settings",
    "GseditError": "errors",
    "InputError": "errors",
    "UsageError": "errors",
    "View": "views.dataset",
    "edit": "edit",
    "edit_steps": "edit",
    "fit": "fitting.fit",
    "fit_steps": "fitting.fit",
    "load": "files",
    "load_dataset": "files",
    "orbit": "views.orbit",
    "save": "files",
    "write_edit": "session.folder",
}


def __getattr__(name: str) -> Any:
    """PEP 562: the object of that name, from the module that defines it."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


class _Package(ModuleType):
    """Keeps `gsedit.edit` the function: importing gsedit/edit.py would make it the module.

    The import system sets a submodule as an attribute of its package, which would hide the public
    name. The module stays in `sys.modules`, where `from gsedit.edit import ...` finds it.
    """

    def __setattr__(self, name: str, value: Any) -> None:
        if name in _HOMES and isinstance(value, ModuleType):
            value = getattr(value, name)
        super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package
