"""One view of an edit before it is done: as routes change it, or as a 2D editor draws it.

`h w` pixels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool
from PIL import Image
from torch import Tensor

from gsedit.editing.edit import change_steps
from gsedit.editing.painters import Looking, painted
from gsedit.editing.parts import SUBJECT, aimed_at, find_parts
from gsedit.editing.plan import key_of
from gsedit.formats.pictures import fitted_size
from gsedit.paper.diffusion.settings import SamplerSettings
from gsedit.paper.editors.protocol import EditBatch, Editor, following
from gsedit.paper.guided import carry_change
from gsedit.paper.session import edit_camera
from gsedit.pictures.contact_sheet import contact_sheet
from gsedit.run.events import returned
from gsedit.scene.merging import MergedScene
from gsedit.scene.outcome import same
from gsedit.select.finder import Finder, Names
from gsedit.select.region import Region, coverage, lift
from gsedit.views.dataset import View, evenly_spaced
from gsedit.views.image_ops import downscale
from gsedit.views.viewpoints import Viewpoint
from gsedit.words.instruction import Instruction
from gsedit.words.phrases import IT
from rasterizer.camera import Camera
from rasterizer.render import render_picture
from rasterizer.scene import Gaussians

SEARCHED_VIEWS = 6
"""Views in which the subject is searched for a preview."""


@dataclass(frozen=True, eq=False)
class Preview:
    """One view before an edit, and what it would become."""

    before: View
    after: View
    notes: tuple[str, ...] = ()
    """Remarks of the edit for a person: what was found, and what was done."""

    def picture(self) -> Image.Image:
        """Before and after beside each other."""
        return contact_sheet([("before | after", (self.before, self.after))])


@torch.no_grad()
def preview_exact(
    scene: Gaussians,
    step: Instruction,
    viewpoints: Sequence[Viewpoint],
    region: str = SUBJECT,
    names: Names | None = None,
) -> Preview:
    """The first view of a scene as the painters change it, about as the whole edit will.

    What names or changes objects is done on the whole scene, in all views, as the edit does it:
    fewer would find other objects. For looks the subject is searched in few views. Raises
    UsageError as `change_steps`.
    """
    camera, some, shown, changes = viewpoints[0].camera, viewpoints, None, step.changes
    if not any(each.route == "object" or each.phrase not in ("", IT) for each in changes):
        some = [viewpoints[i] for i in evenly_spaced(len(viewpoints), SEARCHED_VIEWS + 1)]
        shown = shown_by(scene, camera)
    changed = returned(change_steps(Finder(scene, some, region, names), (step,), shown=shown))
    before, after = (render_picture(each, camera) for each in (scene, changed.scene))
    found = () if changed.region.is_all else (f"region: {changed.region.note}",)
    notes = (*found, *changed.notes)
    return Preview(View("before", camera, before), View("after", camera, after), notes)


@torch.no_grad()
def preview_coarse(
    merged: MergedScene,
    step: Instruction,
    finder: Finder,
    cameras: Sequence[Camera],
    camera: Camera,
) -> Gaussians:
    """The finder's scene about as an exact step makes it, and soon: the groups of the merged one
    are changed, as few `cameras` and this one see them. Raises UsageError as `change_steps`."""
    (step,) = aimed_at((step,), finder.region)
    found = find_parts((step,), finder)
    shown = shown_by(merged.scene, camera)
    flags = {key: merged.majority(each) for key, each in found.flags.items()} | {"shown": shown}
    parts, looking = replace(found, flags=flags), Looking(cameras, coarse=True)
    return merged.carry(painted(step, parts, same(merged.scene), looking)[1])


def drawn_region(finder: Finder, step: Instruction, editor: Editor) -> Region | None:
    """The region that a drawn step may change; None where only its pictures will tell.

    Raises UsageError as `find_parts`.
    """
    (step,) = aimed_at((step,), finder.region)
    return find_parts((step,), finder, editor).now(key_of(step.changes[0]))


def shown_by(scene: Gaussians, camera: Camera) -> Bool[Tensor, " n"]:
    """The Gaussians that a camera shows: for its picture, only they need new reflections."""
    ones = torch.ones(camera.height, camera.width)
    # of fewer pixels, reflections are not computed
    return lift(scene, [camera], [ones]).weight > 0.05


@torch.no_grad()
def preview_edited(
    scene: Gaussians,
    step: Instruction,
    camera: Camera,
    editor: Editor,
    seed: int = 0,
    sampler: SamplerSettings | None = None,
    size: int | None = None,
    region: Region | None = None,
) -> Preview:
    """One view as a 2D editor draws it alone; no scene is fitted to it.

    `size`: longer side of the picture that the editor is given, as `EditSettings.edit_size`;
    `region`: what may change (None: everything).

    Raises UsageError where the editor cannot follow the step.
    """
    editor = following(editor, step)
    sampler = sampler or SamplerSettings()
    before = render_picture(scene, camera)
    declared, longest = editor.capabilities, camera.longest
    size = size or declared.best_size or longest
    if size > longest and declared.enlarges:
        shown = render_picture(scene, edit_camera(camera, size))[None]
    else:
        shown = downscale(before, *fitted_size(camera.width, camera.height, size))[None]
    batch = EditBatch(shown, shown, step.text, seed=seed)
    *_, last = editor.edit(batch, sampler, torch.Generator().manual_seed(seed))
    assert last.images is not None  # the protocol: the last item has them
    drawn = carry_change(last.images, shown, before[None])[0].clamp(0, 1)
    if region is not None:
        covered = coverage(region, scene, camera)[..., None]
        drawn = torch.lerp(before, drawn, covered.to(drawn))
    return Preview(View("before", camera, before), View("after", camera, drawn))
