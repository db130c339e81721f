"""Edit captured 3D scenes (3D Gaussian splats) from a sentence, on a machine without a GPU."""

from gsedit.edit import EditResult, EditSettings, edit, edit_steps
from gsedit.errors import GseditError, InputError, UsageError
from gsedit.files import load, load_dataset, save
from gsedit.fitting.fit import FitResult, FitSettings, fit, fit_steps
from gsedit.reports.journal import Checkpoint, Event
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
]
