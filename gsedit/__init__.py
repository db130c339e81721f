"""Edit captured 3D scenes (3D Gaussian splats) from a sentence, on a machine without a GPU.

Each name is imported when it is first used: `import gsedit.errors` loads no torch.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from rasterizer.lazy import make_lazy
from rasterizer.notebook import draw_scenes_with

if TYPE_CHECKING:
    from gsedit.edit import edit, edit_steps
    from gsedit.errors import GseditError, InputError, UsageError
    from gsedit.files import load, load_dataset, save
    from gsedit.files.animations import write_gif, write_mp4
    from gsedit.fitting.fit import FitResult, fit, fit_steps
    from gsedit.fitting.settings import FitSettings
    from gsedit.points.differences import SceneDifference, diff
    from gsedit.reports.events import Checkpoint, Event
    from gsedit.reports.frames import Animation
    from gsedit.reports.rendered_views import write_view
    from gsedit.session.folder import write_edit
    from gsedit.session.result import EditResult
    from gsedit.session.settings import EditSettings
    from gsedit.viewer.point_clouds import to_open3d, to_pyvista, to_trimesh
    from gsedit.views.dataset import Dataset, View
    from gsedit.views.maps import render_maps
    from gsedit.views.orbit import orbit
    from gsedit.views.paths import camera_path

__all__ = [
    "Animation",
    "Checkpoint",
    "Dataset",
    "EditResult",
    "EditSettings",
    "Event",
    "FitResult",
    "FitSettings",
    "GseditError",
    "InputError",
    "SceneDifference",
    "UsageError",
    "View",
    "camera_path",
    "diff",
    "edit",
    "edit_steps",
    "fit",
    "fit_steps",
    "load",
    "load_dataset",
    "orbit",
    "render_maps",
    "save",
    "to_open3d",
    "to_pyvista",
    "to_trimesh",
    "write_edit",
    "write_gif",
    "write_mp4",
    "write_view",
]

make_lazy(
    __name__,
    {
        "edit": ("edit", "edit_steps"),
        "errors": ("GseditError", "InputError", "UsageError"),
        "files": ("load", "load_dataset", "save"),
        "files.animations": ("write_gif", "write_mp4"),
        "fitting.fit": ("FitResult", "fit", "fit_steps"),
        "fitting.settings": ("FitSettings",),
        "points.differences": ("SceneDifference", "diff"),
        "reports.events": ("Checkpoint", "Event"),
        "reports.frames": ("Animation",),
        "reports.rendered_views": ("write_view",),
        "session.folder": ("write_edit",),
        "session.result": ("EditResult",),
        "session.settings": ("EditSettings",),
        "viewer.point_clouds": ("to_open3d", "to_pyvista", "to_trimesh"),
        "views.dataset": ("Dataset", "View"),
        "views.maps": ("render_maps",),
        "views.orbit": ("orbit",),
        "views.paths": ("camera_path",),
    },
)

draw_scenes_with("gsedit.reports.notebook:scene_png")
