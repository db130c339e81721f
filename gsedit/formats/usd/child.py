"""The child process that runs usd-core: `python -m gsedit.formats.usd.child TASK FROM TO LIMITS`.

It exits with 0, or with 1 and one line on stdout that says what is wrong with the file.
"""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import IO, Any

import numpy as np

from gsedit.errors import InputError
from gsedit.run.inputs import file_inside, safe_name

SCHEMA = "ParticleField3DGaussianSplat"
DEGREE = "radiance:sphericalHarmonicsDegree"
COEFFICIENTS = "radiance:sphericalHarmonicsCoefficients"
ORIENTATIONS = "orientations"
MAX_DEGREE = 4
WIDTHS = {"positions": 3, ORIENTATIONS: 4, "scales": 3, "opacities": 1, COEFFICIENTS: 3}
"""Numbers a row of each attribute; quaternions are wxyz, as xyzw in numpy's view of usd-core's."""
_DRAWN = {"Mesh", "Points", "Cube", "Sphere", "Cylinder", "Cone", "Capsule", "BasisCurves",
          "ParticleField", "PointInstancer", "Volume"}  # fmt: skip
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


def read(source: Path, target: Path) -> None:
    """Write the numbers of all splats of a stage one after the other as float32, and beside them
    TARGET.json, which says what they are. Raises InputError for what is not supported."""
    Sdf, Usd, UsdGeom = _pxr("Sdf"), _pxr("Usd"), _pxr("UsdGeom")
    check_layers(Sdf, source)
    stage = Usd.Stage.Open(str(source))
    places = UsdGeom.XformCache()
    splats, others, hidden = [], 0, 0
    with target.open("wb") as file:
        for prim in Usd.PrimRange.Stage(stage, Usd.TraverseInstanceProxies()):
            others += prim.GetTypeName() in _DRAWN
            if prim.GetTypeName() != SCHEMA:
                continue
            if UsdGeom.Imageable(prim).ComputeVisibility() == UsdGeom.Tokens.invisible:
                hidden += 1
                continue
            _refuse_motion(UsdGeom, prim)
            matrix = np.array(places.GetLocalToWorldTransform(prim)).T.tolist()
            splats.append({"matrix": matrix, **_values(prim, file)})
    units = {
        name: stage.GetMetadata(name)
        for name in ("metersPerUnit", "upAxis")
        if stage.HasAuthoredMetadata(name)
    }
    about = stage.GetRootLayer().customLayerData.get("gsedit")
    about = about if isinstance(about, dict) else {}
    comments: Any = about.get("comments")
    record = {
        "splats": splats, "others": others, "hidden": hidden, "units": units,
        "comments": list(comments) if isinstance(comments, _pxr("Vt").StringArray) else [],
        "antialiased": about.get("antialiased") is True,
    }  # fmt: skip
    target.with_suffix(".json").write_text(json.dumps(record), encoding="utf-8")


def _values(prim: Any, file: IO[bytes]) -> dict[str, Any]:
    """Append a definition's numbers to the file; its name, count and degree, and where each
    attribute begins."""
    name, lists, at = prim.GetName(), dict[str, np.ndarray](), dict[str, int]()
    for attribute, width in WIDTHS.items():
        for each in (attribute, f"{attribute}h"):  # the second has half precision
            found = prim.GetAttribute(each)
            if found.GetNumTimeSamples():
                raise InputError(f"{name}: its {attribute} change over time")
            value = found.Get()
            if value is not None and len(value) and attribute not in lists:
                rows = np.array(value, np.float32).reshape(-1, width)
                lists[attribute] = np.roll(rows, 1, 1) if attribute == ORIENTATIONS else rows
    degree = prim.GetAttribute(DEGREE).Get() if COEFFICIENTS in lists else 0
    degree = 3 if degree is None else degree
    if not 0 <= degree <= MAX_DEGREE:
        raise InputError(f"{name}: an SH degree of {degree}: 0 to {MAX_DEGREE} are read")
    count = len(lists.get("positions", ()))
    for attribute, rows in lists.items():
        needed = count * (degree + 1) ** 2 if attribute == COEFFICIENTS else count
        if len(rows) < needed:
            raise InputError(f"{name} has {len(rows)} {attribute}, {needed} are needed")
        at[attribute] = file.tell() // 4
        file.write(np.ascontiguousarray(rows[:needed]).data)
    linear = str(prim.GetAttribute("colorSpace:name").Get() or "").startswith("lin_")
    return {"name": name, "count": count, "degree": degree, "linear": linear, "at": at}


def _refuse_motion(usd_geom: Any, prim: Any) -> None:
    while prim.GetPath().IsPrimPath():
        if usd_geom.Xformable(prim).GetTimeSamples():
            raise InputError(f"{prim.GetName()}: its place changes over time")
        prim = prim.GetParent()


def check_layers(sdf: Any, source: Path) -> None:
    """Raise InputError for a layer that names one elsewhere than in the folder or the package."""
    waiting, seen = [str(source)], {str(source)}
    while waiting:
        layer = sdf.Layer.FindOrOpen(waiting.pop())
        if layer is None:
            continue  # the stage opens without it
        _refuse_clips(layer)
        for name in layer.GetCompositionAssetDependencies():
            if not name:
                continue  # the same layer
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


def write(source: Path, target: Path) -> None:
    """Write the rows in a folder, as `gsedit.formats.usd.file` leaves them, by the suffix."""
    Gf, Sdf, Usd, UsdUtils, Vt = map(_pxr, ("Gf", "Sdf", "Usd", "UsdUtils", "Vt"))
    record = json.loads((source / "record.json").read_text(encoding="utf-8"))
    stage = Usd.Stage.CreateInMemory()
    stage.SetMetadata("metersPerUnit", record["meters"])
    stage.SetMetadata("upAxis", record["up"])
    about = {"antialiased": True} if record["antialiased"] else {}
    if record["comments"]:
        about["comments"] = Vt.StringArray(record["comments"])
    custom = {"creator": "gsedit"} | ({"gsedit": about} if about else {})
    stage.GetRootLayer().customLayerData = custom
    prim = stage.DefinePrim("/Splats", SCHEMA)
    stage.SetDefaultPrim(prim)
    bounds = Vt.Vec3fArray([Gf.Vec3f(*row) for row in record["extent"]])
    prim.GetAttribute("extent").Set(bounds)
    prim.GetAttribute(DEGREE).Set(record["degree"])
    for name, width in WIDTHS.items():
        rows = np.fromfile(source / name.replace(":", "."), np.float32).reshape(-1, width)
        kind = {1: Vt.FloatArray, 3: Vt.Vec3fArray, 4: Vt.QuatfArray}[width]
        rows = np.roll(rows, -1, 1) if name == ORIENTATIONS else rows[:, 0] if width == 1 else rows
        prim.GetAttribute(name).Set(kind.FromNumpy(np.ascontiguousarray(rows)))
    coefficients = prim.GetAttribute(COEFFICIENTS)
    coefficients.SetMetadata("elementSize", (record["degree"] + 1) ** 2)
    coefficients.SetMetadata("interpolation", "vertex")
    suffix = target.suffix.lower()
    plain = source / "Splats.usdc" if suffix == ".usdz" else target
    kind = "usda" if suffix == ".usda" else "usdc"
    if not stage.GetRootLayer().Export(str(plain), args={"format": kind}):
        raise ValueError("it could not be written")
    if suffix == ".usdz" and not UsdUtils.CreateNewUsdzPackage(
        Sdf.AssetPath(str(plain)), str(target)
    ):
        raise ValueError("it could not be packed")


TASKS: dict[str, Callable[[Path, Path], None]] = {"read": read, "write": write}


def main(task: str, source: str, target: str, *limits: str) -> int:
    limit(*map(int, limits))
    try:
        TASKS[task](Path(source), Path(target))
    except Exception as error:  # also the library's, whose class is not to be imported before
        told = " ".join(str(error).split()).rpartition(" in file ")[2]
        told = told.removeprefix("/").partition(" : ")[2] or told
        sys.stdout.write(told.strip("' ").replace(f"{source}:", "line "))
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
