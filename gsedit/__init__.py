"""Edit captured 3D scenes (3D Gaussian splats) from a sentence, on a machine without a GPU.

Each name is imported when it is first used: `import gsedit.errors` loads no torch.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from rasterizer.lazy import make_lazy
from rasterizer.notebook import draw_scenes_with

if TYPE_CHECKING:
    from gsedit.capture.fitting.fit import FitResult, fit, fit_steps
    from gsedit.capture.fitting.settings import FitSettings
    from gsedit.editing.edit import edit, edit_steps
    from gsedit.editing.folder import write_edit
    from gsedit.editing.measure import EditResult
    from gsedit.errors import GseditError, InputError, UsageError
    from gsedit.formats.scenes import load, save
    from gsedit.paper.settings import EditSettings
    from gsedit.pictures.animations import Animation, write_loop, write_mp4
    from gsedit.pictures.maps import render_maps
    from gsedit.pictures.rendered_views import write_view
    from gsedit.pictures.viewer.point_clouds import to_open3d, to_pyvista, to_trimesh
    from gsedit.run.events import Checkpoint, Event
    from gsedit.toolkit.differences import SceneDifference, diff
    from gsedit.views.dataset import Dataset, View
    from gsedit.views.load import load_dataset
    from gsedit.views.orbit import orbit
    from gsedit.views.paths import camera_path
    from rasterizer import Camera, Gaussians, render

make_lazy(__name__)

draw_scenes_with("gsedit.pictures.notebook:scene_png")
