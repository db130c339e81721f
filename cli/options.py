"""Options that several verbs share, each named once, and the checks made before any work begins."""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_type_hints

import typer

if TYPE_CHECKING:
    import torch

Scene = Annotated[
    Path, typer.Argument(metavar="SCENE", help="A Gaussian splat scene (.ply).", show_default=False)
]
Data = Annotated[
    Path | None,
    typer.Option(
        "--data",
        metavar="DATASET",
        show_default=False,
        help="Folder of posed photos: nerfstudio (transforms.json) or COLMAP.",
    ),
]
Size = Annotated[
    int,
    typer.Option("--size", min=16, metavar="PIXELS", help="Longer side of the pictures worked on."),
]
DropInvalid = Annotated[
    bool,
    typer.Option(
        "--drop-invalid", help="Leave out Gaussians with NaN or Inf instead of refusing the file."
    ),
]
Force = Annotated[
    bool, typer.Option("--force", "-f", help="Overwrite what stands at the output already.")
]


def output(what: str) -> Any:
    """The -o option of a verb that writes `what`."""
    return typer.Option("--output", "-o", metavar="PATH", show_default=False, help=what)


@dataclass(frozen=True)
class Common:
    """What every verb understands."""

    json: Annotated[
        bool, typer.Option("--json", help="Results and events as JSON lines on stdout.")
    ] = False
    debug: Annotated[
        bool, typer.Option("--debug", help="Show the traceback of an error.")
    ] = False
    threads: Annotated[
        int | None,
        typer.Option("--threads", min=1, show_default="as torch finds", help="CPU threads to use."),
    ] = None

    def __post_init__(self) -> None:
        if self.threads:  # read by OpenMP when torch is loaded, which has not happened yet
            os.environ["OMP_NUM_THREADS"] = str(self.threads)


@dataclass(frozen=True)
class Seeded(Common):
    """What a verb that draws random numbers understands too."""

    seed: Annotated[
        int, typer.Option("--seed", help="Same seed, same threads: same result.")
    ] = 0

    def generator(self) -> torch.Generator:
        import torch

        return torch.Generator().manual_seed(self.seed)


def flat(body: Callable[..., None]) -> Callable[..., None]:
    """A command whose parameters are those of `body`, its dataclasses spread into their fields.

    Options that travel together are a type in the code and stay single options on the command line.
    """
    hints = get_type_hints(body, include_extras=True)
    single, grouped = [], {}
    for name, parameter in inspect.signature(body).parameters.items():
        if is_dataclass(hints[name]):
            grouped[name] = hints[name]
        else:
            single.append(parameter.replace(annotation=hints[name]))
    for group in grouped.values():
        types = get_type_hints(group, include_extras=True)
        single += [
            inspect.Parameter(
                field.name, inspect.Parameter.KEYWORD_ONLY, default=field.default,
                annotation=types[field.name],
            )
            for field in fields(group)
        ]

    def command(**values: Any) -> None:
        groups = {
            name: group(**{field.name: values.pop(field.name) for field in fields(group)})
            for name, group in grouped.items()
        }
        body(**values, **groups)

    command.__name__, command.__doc__ = body.__name__, body.__doc__
    keywords = [p.replace(kind=inspect.Parameter.KEYWORD_ONLY) for p in single]
    command.__signature__ = inspect.Signature(keywords)  # pyright: ignore[reportFunctionMemberAccess]
    command.__annotations__ = {p.name: p.annotation for p in keywords}
    return command


def given(options: Any) -> dict[str, Any]:
    """The fields of a group of options that the user set: the rest is for the library to choose."""
    return {
        field.name: value
        for field in fields(options)
        if (value := getattr(options, field.name)) is not None
    }


def check_file(path: Path, suffix: str, force: bool) -> None:
    """Raise UsageError unless a file with this suffix can be written at `path`."""
    from gsedit.errors import UsageError

    if path.suffix.lower() != suffix:
        raise UsageError(f"-o {path}: name a {suffix} file, such as {path.with_suffix(suffix)}")
    if path.is_dir():
        raise UsageError(f"-o {path}: is a folder; name a {suffix} file")
    if path.exists() and not force:
        raise UsageError(f"-o {path}: exists already; choose another name, or overwrite it with -f")
    _check_writable(path.parent)


def check_folder(path: Path, force: bool) -> None:
    """Raise UsageError unless `path` can be a folder of results: new or empty, or -f was given."""
    from gsedit.errors import UsageError

    if path.exists() and not path.is_dir():
        raise UsageError(f"-o {path}: is a file; name a folder")
    _check_writable(path)
    if path.is_dir() and any(path.iterdir()) and not force:
        raise UsageError(
            f"-o {path}: has files in it already; choose another folder, or overwrite them with -f"
        )


def _check_writable(folder: Path) -> None:
    from gsedit.errors import UsageError

    nearest = next(p for p in (folder, *folder.absolute().parents) if p.exists())
    if not nearest.is_dir():
        raise UsageError(f"-o: {nearest} is a file, so nothing can be written below it")
    if not os.access(nearest, os.W_OK | os.X_OK):
        raise UsageError(f"-o: no permission to write in {nearest}; choose another place")


def whole_numbers(text: str, option: str) -> list[int]:
    """Numbers separated by commas, as in `--views 0,8,16`; UsageError otherwise."""
    from gsedit.errors import UsageError

    try:
        return [int(part) for part in text.split(",")]
    except ValueError:
        raise UsageError(f"{option} {text}: give numbers separated by commas, as in 0,8,16") from None
