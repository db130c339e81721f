"""Options that select Gaussians: by an expression, a region, a pixel of a view, or words."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from gsedit.errors import UsageError

from ..core.command import Values, option
from ..core.console import print_message
from ..core.current import current_scene
from .cameras import ViewOptions, resolve_cameras

if TYPE_CHECKING:
    from jaxtyping import Float
    from torch import Tensor

    from gsedit.select.finder import Finder
    from gsedit.select.masked import MaskProvider
    from gsedit.select.region import Region
    from gsedit.select.selection import Selection
    from rasterizer.scene import Gaussians


@dataclass(frozen=True)
class AtOptions:
    """The option that chooses a thing by pixels."""

    at: list[str] | None = option(None, "VIEW:X,Y")
    """Select the object at a pixel, as in frame_00012.jpg:130,80 or 3:130,80; repeatable: the same
    place again is the part of it there, and then a smaller one. not:VIEW:X,Y takes away what is
    there. Column and row of the view at --size."""

    def expression(self) -> str:
        """Return the expression of the places. Raises UsageError for one that is none."""
        from gsedit.select.where import expression_of_clicks

        return expression_of_clicks(self.at or ())

    def in_place_of_region(self, values: Values) -> Values:
        """Return the settings of an edit with what is pointed at as their region.

        Raises UsageError for --region beside it, or a place that is none.
        """
        if not self.at:
            return values
        if ("region",) in values:
            raise UsageError("--at and --region both say where: leave one out")
        return {**values, ("region",): self.expression()}


@dataclass(frozen=True)
class PointingOptions(AtOptions):
    """Options that choose a thing by a pixel or by words."""

    phrase: str | None = option(None, "PHRASE")
    """Select by words, as in 'the red one', 'second from the left', 'the ground'."""
    size: int | None = option(None, "PIXELS", min=16)
    """Longer side of the views that --at counts in. None: 256."""

    @property
    def given(self) -> bool:
        """Whether anything was pointed at."""
        return bool(self.at) or self.phrase is not None

    def check(self) -> None:
        """Raise UsageError for both ways at once, or a place that is none."""
        if self.at and self.phrase is not None:
            raise UsageError("--at and --phrase both name a thing: leave one out")
        if self.at:
            self.expression()

    def region(self, finder: Finder) -> Region:
        """Return what is pointed at. Raises UsageError where that is nothing."""
        return finder.select(self.expression()) if self.at else finder.named(self.phrase or "")


def finder_in(
    data: Path | None, size: int | None = None, masks: MaskProvider | None = None
) -> Callable[[Gaussians], Finder]:
    """Return the maker of a finder of the scene that the command reads, with its views and names.

    Views are those of `data`, of the cameras.json beside the scene, or found ones.
    """

    def finder(scene: Gaussians) -> Finder:
        from gsedit.select.finder import Finder, Names
        from gsedit.select.saved import saved_files

        path = current_scene.get()
        saved = {} if path is None else saved_files(path)
        views = resolve_cameras(path, scene, ViewOptions(data, size=size))
        return Finder(scene, views.viewpoints, names=Names(saved, masks))

    return finder


@dataclass(frozen=True)
class SelectionOptions:
    """Options that select the Gaussians a verb acts on."""

    where: str | None = option(None, "EXPRESSION")
    """Select by value, volume, color or view, as in 'opacity > 0.1 and not sphere(0,0,0,1)'.
    docs/howto/select.md lists all forms."""
    region: str | None = option(None, "REGION")
    """Select a region of gsedit edit: auto (the subject), a saved name, box:X,Y,Z,X,Y,Z,
    sphere:X,Y,Z,R, a .npy file of flags, or masks on photos (.png or a folder)."""
    data: Path | None = option(None, "DATASET")
    """Cameras for a selection by views: posed photos, or a cameras.json. None: cameras.json beside
    the scene."""

    @property
    def given(self) -> bool:
        """Whether --where or --region was given."""
        return self.where is not None or self.region is not None

    def selection(self) -> Selection:
        """Return the selection: everything if no option is given, the intersection of both.

        Raises UsageError for a text that cannot be read.
        """
        from gsedit.select.selection import EVERYTHING

        if self.where is None:
            return EVERYTHING if self.region is None else parse_region(self.region, self.data)
        part = parse_where(self.where, self.data)
        return part if self.region is None else parse_region(self.region, self.data) & part


def need_selection(options: SelectionOptions, verb: str) -> Selection:
    """Return the selection of a verb's options. Raises UsageError where none is given."""
    if not options.given:
        raise UsageError(
            f"{verb} needs a selection: add --where EXPRESSION, as in --where 'opacity > 0.1', or "
            "--region REGION"
        )
    return options.selection()


def parse_where(text: str, data: Path | None) -> Selection:
    """Read the expression of --where. Raises UsageError.

    The functions that need cameras take those of `data`, or those beside the current scene.
    """
    from gsedit.select.where import where

    try:
        return where(text, view_functions(data))
    except UsageError as error:
        raise UsageError(f"--where {error}") from None


def parse_region(text: str, data: Path | None) -> Selection:
    """Read what `--region` selects in the scene that the verb reads. Raises UsageError."""
    from gsedit.select.where import check_region

    return check_region(text, view_functions(data))


def view_functions(data: Path | None) -> dict[str, Callable[..., Selection]]:
    """Return the functions of an expression that look at a scene, by name.

    They look through the cameras of `data`, or those beside the current scene; what was found is
    printed. Without an argument `cameras`, `seen` and `middle` need one of the two.
    """
    from gsedit.select.kinds import LEAST_PIXELS, flags
    from gsedit.select.kinds import middle as in_the_middle
    from gsedit.select.kinds import seen as seen_in
    from gsedit.select.where import questions

    scene = str(current_scene.get() or "")

    def cameras_of(given: str, name: str) -> str:
        return given or str(recorded_cameras(f"{name}()", data))

    def seen(cameras: str = "", pixels: float = LEAST_PIXELS) -> Selection:
        return seen_in(cameras_of(cameras, "seen"), pixels, scene)

    def middle(within: float = 0.5, cameras: str = "") -> Selection:
        return in_the_middle(within, cameras_of(cameras, "middle"), scene)

    asked = questions(finder_in(data), lambda found: print_message(f"region: {found}"))
    # flags: of rows as the file has them, without a look
    return {**asked, "seen": seen, "middle": middle, "flags": flags}


def recorded_cameras(asker: str, data: Path | None) -> Path:
    """Return `data`, or the cameras.json beside the scene. Raises UsageError without either."""
    from gsedit.views.cameras_json import cameras_file

    scene = current_scene.get()
    cameras = data or (cameras_file(scene) if scene else None)
    if cameras is None:
        raise UsageError(
            f"{asker} needs cameras: add --data with the photos' folder or a cameras.json"
        )
    return cameras


@dataclass(frozen=True)
class MaskOptions:
    """Options of the network or program that finds what --phrase names in pictures."""

    masks: str | None = option(None, "NAME")
    """Find the phrase in pictures of the scene. command: by a program of yours (--masks-run);
    clipseg: by a network of transformers (--masks-model); or a name that a package adds. Without
    it, by colors, sizes and places alone."""
    masks_run: str | None = option(None, "COMMAND")
    """The program of --masks command, as in "my_segmenter {input} {output} {phrase}". It must write
    to the folder {output} a mask (PNG, white where it is) for each PNG in {input}. No shell is
    involved."""
    masks_model: str | None = option(None, "FOLDER")
    """Folder of CLIPSeg's weights."""

    def check_unused(self) -> None:
        """Raise UsageError where any is given, for a sentence that a 2D editor draws."""
        if any(vars(self).values()):
            raise UsageError(
                "--masks finds what is changed on the Gaussians, and a 2D editor draws this: save "
                "what it finds with gsedit select --phrase ... --as NAME, and add --region NAME"
            )

    def make(self, phrase: str | None) -> MaskProvider | None:
        """Return the provider, which prints a line a picture; None where none is named.

        Raises UsageError for an option that it does not take, one without --masks, and --masks
        without a phrase, or with one that it cannot look for.
        """
        given = {"run": self.masks_run, "model": self.masks_model}
        if self.masks is None:
            for name, value in given.items():
                if value is not None:
                    raise UsageError(f"--masks-{name} is for --masks: add its NAME")
            return None
        if phrase is None:
            raise UsageError('--masks looks for a phrase: add --phrase "the chair"')
        from gsedit.paper.editors import make_masks

        provider = make_masks(self.masks, **given)
        provider.check(phrase)
        return Told(provider)


@dataclass(frozen=True, eq=False)
class Told:
    """A MaskProvider that prints what it does."""

    provider: MaskProvider

    @property
    def name(self) -> str:
        """The name of the provider itself."""
        return self.provider.name

    def check(self, phrase: str) -> None:
        """Raise UsageError as the provider does."""
        self.provider.check(phrase)

    def masks(
        self, pictures: Sequence[Float[Tensor, "_ _ 3"]], phrase: str
    ) -> Iterator[Float[Tensor, "_ _"]]:
        """Yield the masks of the provider."""
        print_message(f"masks: {self.name} looks for {phrase!r} in {len(pictures)} pictures")
        for number, mask in enumerate(self.provider.masks(pictures, phrase), start=1):
            share = float((mask > 0.5).float().mean())  # of soft masks, more may count
            print_message(f"masks: {number}/{len(pictures)} {100 * share:.1f} % of the picture")
            yield mask
