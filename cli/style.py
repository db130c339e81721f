"""`gsedit style`: the style of a picture for a scene, without words or an editor."""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .cameras import ViewOptions, load_views
from .console import print_message, print_result
from .features import load_features
from .file_options import FileOptions
from .kernel import UPDATES, say_kernel
from .operations import fitted
from .options import DropInvalid, Force, Scene, Seeded, check_scene_file, load_file, output
from .progress import progress
from .selection_options import labelled
from .setting_options import Layout, Setting, SettingsGroup, Values, settings_of, with_values

if TYPE_CHECKING:
    from gsedit.appearance.style import StyleResult
    from gsedit.files import SceneFile
    from gsedit.reports.events import Event
    from rasterizer.scene import Gaussians

Picture = Annotated[
    Path,
    typer.Argument(
        metavar="PICTURE", show_default=False, help="A painting or photo, whose style is taken."
    ),
]
Features = Annotated[
    str,
    typer.Option(
        "--features",
        metavar="filters|vgg|FILE",
        help="What texture is compared by: a filter bank; the VGG16 of the package stlpips_pytorch "
        "(gsedit\\[perceptual]); or a VGG16 of torchvision, .pth or .safetensors.",
    ),
]

Where = Annotated[
    str | None,
    typer.Option(
        "--where",
        metavar="EXPRESSION",
        show_default=False,
        help="Paint only what this selects, as in flags('bear.npy'); all forms are in "
        "docs/selection.md.",
    ),
]


def style_settings() -> list[Setting]:
    """Options of the fields of StyleSettings."""
    from gsedit.appearance.style_settings import StyleSettings

    return settings_of(StyleSettings(), Layout("Style", without=("execution",)))


def style(
    scene: Scene,
    picture: Picture,
    out: Annotated[Path, output("Scene to write; its suffix is the format.")],
    drop_invalid: DropInvalid = False,
    force: Force = False,
    *,
    views: ViewOptions,
    values: Annotated[Values, SettingsGroup(style_settings)],
    features: Features = "filters",
    where: Where = None,
    common: Seeded,
) -> None:
    """Paint a scene in the style of a picture: first its colours, then its texture.

    gsedit style scene.ply painting.jpg -o painted.ply

    gsedit style scene.ply painting.jpg --steps 0 --strength 0.5 -o tinged.ply

    Only colours change. Views are taken from the cameras of --data, else from those of the
    cameras.json beside the scene, else from found ones.
    """
    views.check()
    check_scene_file(out, force)
    common.apply()

    from gsedit.appearance.style import style_steps
    from gsedit.appearance.style_settings import StyleSettings
    from gsedit.files.pictures import read_picture
    from gsedit.points.selection.base import EVERYTHING
    from gsedit.points.selection.where import where as parse

    part = EVERYTHING if where is None else labelled("--where", parse, where)
    settings = with_values(StyleSettings(), values)
    image, extractor = read_picture(picture), load_features(features)
    file = load_file(scene, drop_invalid=drop_invalid)
    if file.header.antialiased:
        print_message(f"{scene} is marked as antialiased: style draws it with the default filter")
    say_kernel(settings.execution, UPDATES)
    steps = style_steps(
        file.scene,
        image,
        dataset=load_views(scene, file.scene, views, settings.execution),
        settings=settings,
        features=extractor,
        where=part,
        generator=common.generator(),
    )
    result = shown(steps, as_json=common.json)
    write(result.scene, file, out, force)
    print_message(f"look: {shlex.join(['gsedit', 'view', f'{scene}', f'{out}'])}")
    record = {"scene": out, "gaussians": len(result.scene), "measures": result.measures}
    print_result(record, str(out), as_json=common.json)


def write(scene: Gaussians, file: SceneFile, out: Path, force: bool) -> None:
    """Write the scene with what its file held beside: extra columns, comments, elements, marks."""
    from gsedit.files.formats import write_scene
    from gsedit.files.streams import in_blocks
    from gsedit.files.table import table_of

    table = table_of(scene).replace(extra=file.extra)
    header, blocks = fitted(file.header, in_blocks(table), out)
    write_scene(out, header, blocks, options=FileOptions().write(out), overwrite=force)


def shown(steps: Iterator[Event | StyleResult], *, as_json: bool) -> StyleResult:
    """The result of the steps, whose events are shown."""
    from gsedit.reports.events import Event

    with progress(as_json=as_json) as show:
        for item in steps:
            if not isinstance(item, Event):
                return item
            show(item)
    raise AssertionError("the steps ended without a result")
