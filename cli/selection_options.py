"""Options that select Gaussians: the same for every verb that acts on a part of a scene.

What they select combines with `and`; --where says the rest.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .options import current_scene

if TYPE_CHECKING:
    from gsedit.points.selection.base import Selection

VOLUMES = "Select by volume"
VALUES = "Select by value"
OTHERS = "Select otherwise"


def chosen(flag: str, metavar: str, help: str, panel: str) -> Any:
    """An option that narrows the selection if it is given."""
    return typer.Option(flag, metavar=metavar, help=help, rich_help_panel=panel, show_default=False)


@dataclass(frozen=True)
class VolumeOptions:
    """Selections by where the centre of a Gaussian is, in units of the scene."""

    box: Annotated[
        str | None,
        chosen("--box", "X0,Y0,Z0,X1,Y1,Z1", "Between two corners; - is an open side.", VOLUMES),
    ] = None
    oriented_box: Annotated[
        str | None,
        chosen(
            "--oriented-box",
            "X,Y,Z,A,B,C[,RX,RY,RZ]",
            "About x,y,z, of sides a,b,c, turned by degrees about x, then y, then z.",
            VOLUMES,
        ),
    ] = None
    sphere: Annotated[str | None, chosen("--sphere", "X,Y,Z,RADIUS", "About a point.", VOLUMES)] = (
        None
    )
    ellipsoid: Annotated[
        str | None,
        chosen(
            "--ellipsoid",
            "X,Y,Z,A,B,C[,RX,RY,RZ]",
            "About x,y,z, of radii a,b,c, turned as --oriented-box.",
            VOLUMES,
        ),
    ] = None
    cylinder: Annotated[
        str | None,
        chosen("--cylinder", "X0,Y0,Z0,X1,Y1,Z1,RADIUS", "About the axis of two points.", VOLUMES),
    ] = None
    half_space: Annotated[
        str | None,
        chosen(
            "--half-space",
            "X,Y,Z,NX,NY,NZ",
            "The side of the plane through x,y,z that nx,ny,nz points to.",
            VOLUMES,
        ),
    ] = None
    inside: Annotated[
        Path | None,
        chosen("--inside", "MESH", "A closed mesh: .obj, .ply, .stl, .off or .glb.", VOLUMES),
    ] = None
    invert: Annotated[
        bool,
        typer.Option("--invert", help="Select what is not selected.", rich_help_panel=OTHERS),
    ] = False

    @property
    def given(self) -> bool:
        """Whether any option was given."""
        return any(getattr(self, each.name) != each.default for each in fields(self))

    def selection(self) -> Selection:
        """What the options select together; everything where none is given. Raises UsageError."""
        return ~self.combined() if self.invert else self.combined()

    def combined(self) -> Selection:
        """The same before --invert."""
        from gsedit.points.selection.base import EVERYTHING, Intersection

        parts = tuple(self.parts())
        return parts[0] if len(parts) == 1 else Intersection(parts) if parts else EVERYTHING

    def parts(self) -> list[Selection]:
        """What each option selects."""
        from gsedit.points.selection import forms

        found = []
        if self.box is not None:
            found.append(forms.box(*closed(numbers("--box", self.box, 6, opens=True))))
        for name, counts in (
            ("oriented_box", (9, 6)),
            ("sphere", (4,)),
            ("ellipsoid", (6, 9)),
            ("cylinder", (7,)),
            ("half_space", (6,)),
        ):
            if (text := getattr(self, name)) is not None:
                flag = f"--{name.replace('_', '-')}"
                found.append(getattr(forms, name)(*numbers(flag, text, *counts)))
        if self.inside is not None:
            found.append(forms.inside(str(self.inside)))
        return found


@dataclass(frozen=True)
class SelectionOptions(VolumeOptions):
    """All selections."""

    min_opacity: Annotated[
        float | None, chosen("--min-opacity", "0..1", "Of this opacity or more.", VALUES)
    ] = None
    max_opacity: Annotated[
        float | None, chosen("--max-opacity", "0..1", "Of this opacity or less.", VALUES)
    ] = None
    min_size: Annotated[
        float | None,
        chosen(
            "--min-size",
            "LENGTH",
            "Of this size or more: the geometric mean of the three standard deviations.",
            VALUES,
        ),
    ] = None
    max_size: Annotated[
        float | None, chosen("--max-size", "LENGTH", "Of this size or less.", VALUES)
    ] = None
    min_anisotropy: Annotated[
        float | None,
        chosen("--min-anisotropy", "RATIO", "Longest / shortest axis: this or more.", VALUES),
    ] = None
    max_anisotropy: Annotated[
        float | None,
        chosen("--max-anisotropy", "RATIO", "Longest / shortest axis: this or less.", VALUES),
    ] = None
    near_color: Annotated[
        str | None,
        chosen(
            "--near-color",
            "#RRGGBB[,DIFFERENCE]",
            "Near a colour, quoted for its #, or that of a pixel, photo.jpg@COLUMN,ROW: by "
            "difference in CIE Lab, 10 if not given.",
            VALUES,
        ),
    ] = None
    largest: Annotated[
        str | None,
        chosen(
            "--largest",
            "N[%],VALUE",
            "The N, or N per cent, with the largest value, as in 1000,opacity.",
            VALUES,
        ),
    ] = None
    smallest: Annotated[
        str | None,
        chosen(
            "--smallest",
            "N[%],VALUE",
            "The same with the smallest, as in '10%,distance(0,0,0)'.",
            VALUES,
        ),
    ] = None
    region: Annotated[
        str | None,
        chosen(
            "--region",
            "REGION",
            "As of gsedit edit: a .npy file of gsedit select or of an edit, masks drawn on photos "
            "or renders (.png or a folder; with --data), auto (with --prompt), box:..., sphere:...",
            OTHERS,
        ),
    ] = None
    data: Annotated[
        Path | None,
        typer.Option(
            "--data",
            metavar="DATASET",
            help="The cameras of --region and --seen: posed photos, or a cameras.json.",
            rich_help_panel=OTHERS,
            show_default="cameras.json beside the scene",
        ),
    ] = None
    prompt: Annotated[
        str | None,
        chosen("--prompt", "INSTRUCTION", "The instruction that --region auto is for.", OTHERS),
    ] = None
    seen: Annotated[
        float | None,
        chosen(
            "--seen",
            "PIXELS",
            "What contributes this many pixels or more to pictures 256 wide of all cameras.",
            OTHERS,
        ),
    ] = None
    cluster: Annotated[
        str | None,
        chosen(
            "--cluster",
            "largest|N|X,Y,Z",
            "The largest cluster of the scene, the N largest, or the one at a point.",
            OTHERS,
        ),
    ] = None
    cluster_gap: Annotated[
        float | None,
        typer.Option(
            "--cluster-gap",
            metavar="LENGTH",
            help="Centres at most this far apart are in one cluster.",
            rich_help_panel=OTHERS,
            show_default="8 median distances to the nearest",
        ),
    ] = None
    grow: Annotated[
        float | None,
        chosen("--grow", "LENGTH", "Then add what is at most this far away.", OTHERS),
    ] = None
    shrink: Annotated[
        float | None,
        chosen(
            "--shrink", "LENGTH", "Then leave out what is at most this far from the rest.", OTHERS
        ),
    ] = None
    where: Annotated[
        str | None,
        chosen(
            "--where",
            "EXPRESSION",
            "As in 'opacity > 0.1 and not sphere(0,0,0,1) or near(#a08050, 10)'; all forms are in "
            "docs/selection.md.",
            OTHERS,
        ),
    ] = None

    def parts(self) -> list[Selection]:
        from gsedit.points.selection.values import at_least, at_most
        from gsedit.points.selection.where import where

        found = super().parts()
        for name in ("opacity", "size", "anisotropy"):
            for bound, make in (("min", at_least), ("max", at_most)):
                if (number := getattr(self, f"{bound}_{name}")) is not None:
                    found.append(make(name, finite(f"--{bound}-{name}", number)))
        if self.near_color is not None:
            found.append(near(self.near_color))
        for name in ("largest", "smallest"):
            if (text := getattr(self, name)) is not None:
                found.append(ranked(name, text))
        found += self.by_views_and_clusters()
        if self.where is not None:
            found.append(labelled("--where", where, self.where))
        return found

    def combined(self) -> Selection:
        from gsedit.points.selection import forms

        selected = super().combined()
        if self.grow is not None:
            selected = forms.grow(selected, self.grow)
        return selected if self.shrink is None else forms.shrink(selected, self.shrink)

    def by_views_and_clusters(self) -> list[Selection]:
        """What --region, --seen and --cluster select."""
        from gsedit.errors import UsageError
        from gsedit.points.selection import forms

        found = []
        if self.region is not None:
            from .selection_region import region_selection

            found.append(region_selection(self.region, self.data, self.prompt))
        if self.seen is not None:
            from gsedit.points.selection.seen import Seen

            from .selection_region import recorded_cameras

            cameras = recorded_cameras("--seen", self.data)
            found.append(Seen(cameras, self.seen, current_scene.get()))
        if self.cluster is not None:
            if "," in self.cluster:
                place = numbers("--cluster", self.cluster, 3)
                found.append(forms.cluster_at(*place, gap=self.cluster_gap))
            elif self.cluster == "largest" or self.cluster.isdecimal():
                count = 1 if self.cluster == "largest" else int(self.cluster)
                found.append(forms.cluster(count, self.cluster_gap))
            else:
                raise UsageError(
                    f"--cluster {self.cluster}: give largest, a number of clusters, or x,y,z"
                )
        for flag, given, needed, names in (
            ("--data", self.data, (self.region, self.seen), "--region or --seen"),
            ("--prompt", self.prompt, (self.region,), "--region auto"),
            ("--cluster-gap", self.cluster_gap, (self.cluster,), "--cluster"),
        ):
            if given is not None and all(each is None for each in needed):
                raise UsageError(f"{flag} is for {names}: add it, or leave {flag} out")
        return found


def need_selection(options: VolumeOptions, verb: str) -> Selection:
    """What the options of a verb select. Raises UsageError where none is given."""
    from gsedit.errors import UsageError

    if not options.given:
        raise UsageError(
            f"{verb} needs to know what: add an option as --box (see gsedit {verb} --help)"
        )
    return options.selection()


def numbers(flag: str, text: str, *counts: int, opens: bool = False) -> list[float]:
    """Finite numbers separated by commas, one of `counts` of them; NaN for `-` where a side may be
    open. Raises UsageError."""
    from math import isfinite

    from gsedit.errors import UsageError

    try:
        found = [
            float("nan") if opens and part.strip() == "-" else finite(flag, float(part))
            for part in text.split(",")
        ]
    except ValueError:
        found = []
    if len(found) not in counts or not all(isfinite(n) or opens for n in found):
        many = "a finite number" if counts == (1,) else f"{' or '.join(map(str, counts))} numbers"
        commas = "" if counts == (1,) else " separated by commas"
        commas += ", or - for an open side" if opens else ""
        raise UsageError(f"{flag} {text}: give {many}{commas}")
    return found


def closed(corners: list[float]) -> list[float]:
    """Two corners, with infinity for the sides that are open."""
    ends = [-float("inf")] * 3 + [float("inf")] * 3
    return [end if isnan(given) else given for given, end in zip(corners, ends)]


def finite(flag: str, number: float) -> float:
    """The number. Raises UsageError where it is infinite or none."""
    from math import isfinite

    from gsedit.errors import UsageError

    if not isfinite(number):
        raise UsageError(f"{flag} {number}: give a finite number")
    return number


def near(text: str) -> Selection:
    """The selection of --near-color."""
    from gsedit.points.selection import forms

    name, at, place = text.rpartition("@")
    parts = place.split(",")
    color = name + at + ",".join(parts[: 2 if at else 1])
    difference = ",".join(parts[2 if at else 1 :])
    rest = numbers("--near-color", difference, 1) if difference else []
    return labelled("--near-color", lambda color: forms.near(color, *rest), color)


def ranked(name: str, text: str) -> Selection:
    """The selection of --largest or --smallest."""
    from gsedit.errors import UsageError
    from gsedit.points.selection import forms
    from gsedit.points.selection.ranked import parse_amount
    from gsedit.points.selection.where import value

    amount, comma, expression = text.partition(",")
    if not comma:
        raise UsageError(f"--{name} {text}: give an amount and a value, as in 1000,opacity")
    return getattr(forms, name)(
        labelled(f"--{name}", parse_amount, amount), labelled(f"--{name}", value, expression)
    )


def labelled(flag: str, parse: Any, text: str) -> Any:
    """What `parse` makes of the text; the flag stands in front of its UsageError."""
    from gsedit.errors import UsageError

    try:
        return parse(text)
    except UsageError as error:
        raise UsageError(f"{flag} {error}") from None
