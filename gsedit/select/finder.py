"""The Gaussians that are said, clicked, marked or measured in a scene: one answer for all.

Sentences, phrases, clicks, `--region` and the page are translated into the expressions of
`gsedit.select.where`; a `Finder` evaluates them in a scene, each once.
"""

from __future__ import annotations

import gzip
import zlib
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, lru_cache, partial
from hashlib import sha256
from io import BytesIO
from pathlib import Path
from pickle import UnpicklingError
from typing import TypeVar

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsedit.errors import GseditError, Said, UsageError
from gsedit.formats.flags import read_flags
from gsedit.run.atomic import atomic_path
from gsedit.run.state import digest_of
from gsedit.scene.table import table_of
from gsedit.select.click import Click, Selector
from gsedit.select.masked import MaskProvider, read_masks
from gsedit.select.phrase import carrier, find_phrase
from gsedit.select.region import Region, coverage, cut_out, find_drawn, lift, within_silhouette
from gsedit.select.saved import key_of_name, read_named
from gsedit.select.segment import Segment, Segments
from gsedit.select.subject import find_subject
from gsedit.select.where import OUTSIDE, expression_of, questions, quoted, where
from gsedit.views.around import find_viewpoints
from gsedit.views.viewpoints import Viewpoint, view_named
from gsedit.words.phrases import BASED, CARRIERS, IT, PRONOUNS, is_noun
from rasterizer.camera import Camera
from rasterizer.compiled import cache_folder
from rasterizer.scene import Gaussians

ALIKE = 0.05
"""IoU by which the object under a mask may show it worse than the Gaussians in it do: on three
captures, objects that do are nearer to the masks of other views, and the others far off."""


@dataclass(frozen=True, eq=False)
class Names:
    """Names that phrases may have, beside the colors, sizes and places that need no network."""

    saved: Mapping[str, Path] = field(default_factory=dict)
    """Files of flags (.npy) of saved selections, by `gsedit.select.saved.key_of_name`."""
    masks: MaskProvider | None = None
    """Finds any noun in pictures."""

    def file_of(self, phrase: str) -> Path | None:
        """The file of the saved selection that a phrase names, with a determiner or without."""
        return self.saved.get(key_of_name(phrase))

    def knows(self, phrase: str) -> bool:
        """Whether the noun of a phrase is known, and not only taken for the subject."""
        return self.masks is not None or self.file_of(phrase) is not None


class Finder:
    """Finds what expressions and phrases name in one scene, each once."""

    def __init__(
        self,
        scene: Gaussians,
        viewpoints: Sequence[Viewpoint] = (),
        region: str = "auto",
        names: Names | None = None,
    ) -> None:
        """Keep the scene, the views in which it is looked at (none: some are found), and the
        region that stands for the subject; nothing is computed yet."""
        self.scene, self.region, self.names = scene.detach(), region, names or Names()
        self._given, self._known = tuple(viewpoints), dict[str, Region]()

    @cached_property
    def viewpoints(self) -> tuple[Viewpoint, ...]:
        """The views in which the scene is looked at."""
        return self._given or find_viewpoints(self.scene)

    @property
    def cameras(self) -> list[Camera]:
        """The cameras of these views."""
        return [each.camera for each in self.viewpoints]

    @cached_property
    def selector(self) -> Selector:
        """The objects of the scene, as clicks select them."""
        return Selector(self.scene, self.cameras)

    def in_region(self, region: str, names: Names) -> Finder:
        """A finder of the same scene with another region for its subject, and other names."""
        other = Finder(self.scene, self.viewpoints, region, names)
        other.selector = self.selector
        return other

    @cached_property
    def segments(self) -> Segments:
        """The objects of the scene."""
        return remembered("segments", self.scene, self.cameras, lambda: self.selector.segments)

    @property
    def subject(self) -> Region:
        """The subject of the scene, or what the region that stands for it holds."""
        return self.select(self.region)

    def rename(self, names: Names) -> None:
        """Take other saved selections and masks; the subject and the objects stay found."""
        subject = self._known.get(self.region)
        self.names, self._known = names, {} if subject is None else {self.region: subject}

    def named(self, phrase: str) -> Region:
        """Gaussians that a phrase names: the subject, a saved selection, or things."""
        return self.select(self.expression(phrase))

    def expression(self, phrase: str) -> str:
        """The expression of a phrase: `subject()` for "it" or a noun alone, `subject(base=True)`
        with what that stands on, `named('chair')` for a saved one, else `thing('the red one')`."""
        if phrase == BASED:
            return "subject(base=True)"
        if phrase == IT or phrase in PRONOUNS:
            return "subject()"
        if is_noun(phrase) and phrase not in CARRIERS and not self.names.knows(phrase):
            return "subject()"
        return f"{'named' if self.names.file_of(phrase) else 'thing'}({quoted(phrase)})"

    def select(self, text: str) -> Region:
        """Gaussians that an expression, or a short form of one, selects.

        Raises UsageError for what is neither, names nothing or is empty; InputError for a file that
        does not fit.
        """
        known = self._known  # a search that runs keeps its result in the names of its beginning
        if text not in known:
            known[text] = self._select(text)
        return known[text]

    def _select(self, text: str) -> Region:
        expression = expression_of(text)
        rule = where(expression, questions(lambda _: self))
        if rule.question is not None:
            found = rule.question(self)
        else:
            found = Region(torch.from_numpy(rule.mask(table_of(self.scene))), text)
        if not found.inside.any():
            raise _empty(text, self.scene)
        return replace(found, how=expression)

    def find_subject(self, *, base: bool = False) -> Region:
        """The main subject; with its `base`, as a plinth, where that is asked for."""
        name = "subject with base" if base else "subject"
        find = partial(find_subject, self.scene, self.cameras, with_carrier=base)
        return remembered(name, self.scene, self.cameras, find)

    def find_clicked(self, clicks: Sequence[tuple[str, float, float]]) -> Region:
        """The object at pixels of views; of whole numbers, in the middle of that pixel."""
        return self.selector.at([click_on(self.viewpoints, *each) for each in clicks])

    def find_thing(self, phrase: str) -> Region:
        """The things that a phrase names."""
        masks = self.names.masks
        known = None if masks is not None else self.segments
        if known is not None and phrase in CARRIERS and (found := carrier(known)):
            return replace(found, inside=cut_out(self.scene, self.cameras, found.inside))

        def main() -> Bool[Tensor, " n"] | None:
            own = "thing(" in self.region and self.region not in self._known  # the region asks
            subject = self.find_subject() if own else self.subject
            return None if subject.is_all else subject.inside

        found = find_phrase(phrase, self.scene, self.cameras, known, main, masks)
        if known is None or known.labels[found.inside].max() >= len(known.objects):
            return found  # the ground and what is behind have no outline of their own
        return replace(found, inside=cut_out(self.scene, self.cameras, found.inside))

    def find_named(self, name: str) -> Region:
        """A selection that was saved beside the scene."""
        file = self.names.file_of(name)
        if file is None:
            names = ", ".join(self.names.saved) or "none: gsedit select ... --as NAME saves one"
            raise UsageError(f"no selection is saved as {name!r}; there is {names}")
        inside = torch.from_numpy(read_named(file, self.scene.means.numpy()))
        return Region(inside, f"{name}, as it was saved")

    def find_flags(self, path: str) -> Region:
        """The Gaussians that a .npy file flags."""
        inside = read_flags(Path(path).expanduser(), len(self.scene))
        return Region(torch.from_numpy(inside), path)

    def find_drawn(self, path: str) -> Region:
        """The Gaussians in masks drawn on views: a .png named after its view, or a folder."""
        masks = read_masks(Path(path).expanduser(), self.viewpoints)
        if not any((mask > 0.5).any() for mask in masks.values()):
            raise UsageError(f"{path} is black: draw white where the object is")
        cameras = [self.viewpoints[i].camera for i in masks]
        drawn = list(masks.values())
        lifted = lift(self.scene, cameras, drawn)
        inside = find_drawn(self.scene, lifted)
        shown = lifted.weight[inside]
        sure = float((lifted.mean[inside] * shown).sum() / shown.sum().clamp_min(1e-9))
        cut = within_silhouette(self.scene, cameras, inside)
        found = Region(cut, path, sure=sure)
        if len(masks) > 1:
            return found
        # one view sees no backs: objects go on there, where they are what was drawn
        with suppress(UsageError):
            object_ = self.selector.mask(cameras[0], drawn[0])
            own, given = (self._shows(r, cameras[0], drawn[0]) for r in (object_, found))
            if own >= given - ALIKE:
                return replace(object_, note=f"{path}: {object_.note}")
        return found

    def _shows(self, region: Region, camera: Camera, mask: Float[Tensor, "h w"]) -> float:
        """IoU of the picture of a region with a mask."""
        shown, drawn = coverage(region, self.scene, camera) > 0.5, mask > 0.5
        return float((shown & drawn).sum() / (shown | drawn).sum().clamp_min(1))


def click_on(views: Sequence[Viewpoint], name: str, x: float, y: float) -> Click:
    """The click at a pixel of one of the views. Raises UsageError for no such view."""
    view = view_named(views, name.removeprefix(OUTSIDE))
    x, y = (each + 0.5 * float(each).is_integer() for each in (x, y))
    return Click(view.camera, x, y, not name.startswith(OUTSIDE), view.name)


def _empty(text: str, scene: Gaussians) -> UsageError:
    """The error for a region that holds nothing."""
    low, high = (
        ", ".join(f"{x:.4g}" for x in corner.tolist())
        for corner in (scene.means.amin(0), scene.means.amax(0))
    )
    what = f"region {text} holds no Gaussian of the scene, whose centers are from"
    return UsageError(Said(f"{what} ({low}) to ({high})", "look-region"))


Found = TypeVar("Found", Region, Segments)
LEAST = 20_000
"""Gaussians of a scene from which looking takes a second."""
torch.serialization.add_safe_globals([Region, Segment, Segments])  # what a record may hold


def remembered(
    name: str, scene: Gaussians, cameras: Sequence[Camera], find: Callable[[], Found]
) -> Found:
    """Return the result found by this name in the scene before, or that `find` finds now.

    A record is of the scene's numbers, of the cameras, and of the program that looks: it is found
    anew where any of them is another.
    """
    file = None if len(scene) < LEAST else _file(name, scene, cameras)
    if file is None:
        return find()
    with suppress(OSError, EOFError, RuntimeError, ValueError, UnpicklingError, zlib.error):
        found = torch.load(BytesIO(gzip.decompress(file.read_bytes())), weights_only=True)
        file.touch()
        return found
    found, record = find(), BytesIO()
    torch.save(found, record)
    with suppress(OSError, GseditError):  # a full disk: it is found again the next time
        with atomic_path(file, overwrite=True) as temporary:
            temporary.write_bytes(gzip.compress(record.getvalue(), 1))
        every = sorted(file.parent.glob("*.gz"), key=lambda each: each.stat().st_mtime)
        for each in every[:-200]:  # 0.2 MB each for 150,000 Gaussians
            each.unlink(missing_ok=True)
    return found


def _file(name: str, scene: Gaussians, cameras: Sequence[Camera]) -> Path | None:
    """The file of a record; None where there is no folder to keep one in."""
    try:
        folder = cache_folder() / "looks"
        folder.mkdir(exist_ok=True)
    except (OSError, GseditError):
        return None
    views = [replace(each, world_to_camera=torch.eye(4)) for each in cameras]
    poses = digest_of(each.world_to_camera for each in cameras)
    asked = sha256(f"{name} {_program()} {views} {poses}".encode()).hexdigest()[:16]
    return folder / f"{digest_of(getattr(scene, each.name) for each in fields(scene))}-{asked}.gz"


@lru_cache(maxsize=1)
def _program() -> str:
    """A digest of the files of this room: another program may find something else."""
    total = sha256()
    for each in sorted(Path(__file__).parent.iterdir()):
        if each.is_file():
            total.update(each.read_bytes())
    return total.hexdigest()
