"""The child process that runs usd-core: `python -m gsedit.formats.usd.child TASK FROM TO LIMITS`.

It exits with 0, or with 1 and one line on stdout that says what is wrong with the file.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any

from gsedit.errors import InputError
from gsedit.storage.inputs import file_inside
from gsedit.storage.safe_names import safe_name

_MOST_LAYERS = 256
"""Layers that one stage may be put together from."""
_IN_PACKAGE = re.compile(r"(?P<file>.*)\[(?P<inside>[^\[\]]*)\]", re.DOTALL)


def limit(memory: int, written: int, seconds: int) -> None:
    """Bound the bytes of memory, of a written file, and the CPU seconds; not on Windows."""
    with suppress(ImportError):
        import resource

        resource.setrlimit(resource.RLIMIT_FSIZE, (written, written))
        resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds))
        with suppress(ValueError, OSError):  # macOS has none for memory
            resource.setrlimit(resource.RLIMIT_AS, (memory, memory))


def _pxr(name: str) -> Any:
    """A module of usd-core, which has no types."""
    return import_module(f"pxr.{name}")


def flatten(source: Path, target: Path) -> None:
    """Write the stage of a file as one .usda. Raises InputError for names outside its folder."""
    Sdf, Usd = _pxr("Sdf"), _pxr("Usd")
    check_layers(Sdf, source)
    stage = Usd.Stage.Open(str(source))
    if not stage.Flatten(False).Export(str(target)):
        raise ValueError("it could not be flattened")


def check_layers(sdf: Any, source: Path) -> None:
    """Raise InputError for a layer that names one elsewhere than in the folder or the package."""
    waiting, seen = [str(source)], {str(source)}
    while waiting:
        layer = sdf.Layer.FindOrOpen(waiting.pop())
        if layer is None:
            continue  # the stage opens without it
        _refuse_clips(layer)
        for name in layer.GetCompositionAssetDependencies():
            if "`" in name:
                raise InputError("a name of another layer is an expression")
            safe_name(name.replace("[", "/").replace("]", ""), "another layer")
            full = sdf.ComputeAssetPathRelativeToLayer(layer, name)
            if not Path(full).is_absolute():
                raise InputError(f"the layer {name[:80]} that it names is missing")
            file = (_IN_PACKAGE.match(full) or {"file": full})["file"]
            file_inside(source.parent, str(Path(file).absolute()), "another layer")
            if full not in seen:
                waiting.append(full)
                seen.add(full)
        if len(seen) > _MOST_LAYERS:
            raise InputError(f"it names more than {_MOST_LAYERS} other layers")


def _refuse_clips(layer: Any) -> None:
    found = []

    def look(path: Any) -> None:
        spec = layer.GetObjectAtPath(path)
        if path.IsPrimPath() and spec is not None and spec.HasInfo("clips"):
            found.append(path)

    layer.Traverse("/", look)
    if found:
        raise InputError("its values are spread over clips")


def pack(source: Path, target: Path) -> None:
    """Write a .usda as .usdc, or as .usdz with it inside."""
    Sdf, UsdUtils = _pxr("Sdf"), _pxr("UsdUtils")
    is_zip = target.suffix.lower() == ".usdz"
    binary = source.with_suffix(".usdc") if is_zip else target
    layer = Sdf.Layer.FindOrOpen(str(source))
    if not layer.Export(str(binary), args={"format": "usdc"}):
        raise ValueError("it could not be written")
    if is_zip and not UsdUtils.CreateNewUsdzPackage(Sdf.AssetPath(str(binary)), str(target)):
        raise ValueError("it could not be packed")


TASKS: dict[str, Callable[[Path, Path], None]] = {"flatten": flatten, "pack": pack}


def main(task: str, source: str, target: str, *limits: str) -> int:
    limit(*map(int, limits))
    try:
        TASKS[task](Path(source), Path(target))
    except Exception as error:  # also the library's, whose class is not to be imported before
        told = " ".join(str(error).split()).rpartition(" in file ")[2]
        sys.stdout.write(told.removeprefix("/").partition(" : ")[2] or told)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
