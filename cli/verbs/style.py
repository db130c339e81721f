"""`gsedit style`: paint a scene in the style of a picture."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from ..core.command import (
    Seeded,
    Setting,
    Settings,
    Values,
    argument,
    option,
    settings_of,
    shows,
    with_values,
)
from ..core.console import print_message, print_result
from ..core.kernel import UPDATES, say_kernel
from ..core.outputs import check_scene_file
from ..core.process import fitted
from ..core.progress import progress, result_of
from ..options.cameras import ViewOptions, load_views
from ..options.common import (
    Reads,
    Scene,
    Writes,
    load_features,
    load_file,
)
from ..options.selection import WhereOptions, parse_where

if TYPE_CHECKING:
    from gsedit.formats.scenes import SceneFile
    from rasterizer.scene import Gaussians

Picture = Annotated[Path, argument("PICTURE", "Painting or photo that gives the style.")]


@dataclass(frozen=True)
class StyleOptions(Reads, Writes, WhereOptions):
    """Options of `gsedit style` alone."""

    out: Path = option(..., "PATH", flags="--output -o")
    """Scene to write; its suffix is the format."""
    features: str = option("filters", "filters|vgg")
    """Features that compare textures. filters: a filter bank. vgg: the VGG16 of stlpips_pytorch
    (gsedit[perceptual])."""


def style_settings() -> list[Setting]:
    """Options of the fields of StyleSettings."""
    from gsedit.editing.style.settings import StyleSettings

    return list(settings_of(StyleSettings(), without=("execution",)))


@shows(
    "--output", "--data", "--where", "--steps", "--strength", "--features", "--size", "--force",
    "--seed",
)  # fmt: skip
def style(
    scene: Scene,
    picture: Picture,
    *,
    own: StyleOptions,
    views: ViewOptions,
    values: Annotated[Values, Settings(style_settings)],
    common: Seeded,
) -> None:
    """Paint a scene in the style of a picture: its colors and its texture.

    gsedit style scene.ply painting.jpg -o painted.ply

    gsedit style scene.ply painting.jpg --steps 0 --strength 0.5 -o tinged.ply

    Only colors change. The views come from --data, else from the cameras.json beside the scene,
    else from viewpoints that gsedit finds.
    """
    views.check()
    check_scene_file(own.out, own.force)

    from gsedit.editing.style.settings import StyleSettings
    from gsedit.editing.style.style import style_steps
    from gsedit.formats.pictures import read_picture
    from gsedit.run.events import Event
    from gsedit.select.rules import EVERYTHING

    part = EVERYTHING if own.where is None else parse_where(own.where, views.data)
    settings = with_values(StyleSettings(), values)
    image, extractor = read_picture(picture), load_features(own.features)
    file = load_file(scene, drop_invalid=own.drop_invalid)
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
    with progress() as show:
        result = result_of(steps, {Event: show})
    write(result.scene, file, own.out, own.force)
    print_message(f"look: {shlex.join(['gsedit', 'view', f'{scene}', f'{own.out}'])}")
    record = {"scene": own.out, "gaussians": len(result.scene), "measures": result.measures}
    print_result(record, str(own.out))


def write(scene: Gaussians, file: SceneFile, out: Path, force: bool) -> None:
    """Write the scene with the extra columns, comments and elements of its file."""
    from gsedit.formats.files import write_scene
    from gsedit.formats.streams import in_blocks
    from gsedit.scene.table import table_of

    table = table_of(scene).replace(extra=file.extra)
    header, blocks = fitted(file.header, in_blocks(table), out)
    write_scene(out, header, blocks, overwrite=force)
