"""Proof that the tests of the table of features fail where a feature is broken.

    python tests/broken_features.py [FEATURE...]

Breaks every feature of docs/reference/toolkit.md in a copy of the tree, one function at a time, and
runs the tests that its row names. Writes one line for each function; exits with 1 where the tests
of a row pass without it. All rows take five to ten minutes on two cores.
"""

from __future__ import annotations

import ast
import compileall
import os
import re
import subprocess
import sys
import tempfile
import time
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).parents[1]
PAGE = "docs/reference/toolkit.md"
PACKAGES = {"gsedit_cli": "cli"}
"""Packages whose folder has another name."""
ABSENT = "raise NotImplementedError"
PLAIN = "addopts=-q --import-mode=importlib"
"""Options of pytest without the checks of shapes: a test must fail by what it states itself."""
LIBRARIES = ("torch", "scipy.spatial", "scipy.sparse", "kornia", "typer.testing", "PIL.Image")
"""Imported once, before the children; none of them imports gsedit."""


class Broken(NamedTuple):
    """One function, and the statement that takes the place of what it does."""

    function: str
    """Its place, as module:qualified.name."""
    statement: str = ABSENT


def opened(*modules: str) -> tuple[Broken, ...]:
    return tuple(Broken(f"gsedit.formats.{module}:open_source") for module in modules)


def written(*modules: str) -> tuple[Broken, ...]:
    return tuple(Broken(f"gsedit.formats.{module}:write") for module in modules)


def masked(module: str, *forms: str, value: str = "zeros") -> tuple[Broken, ...]:
    """Selections that find nothing, or with `ones` everything."""
    module, statement = f"gsedit.select.{module}", f"return np.{value}(len(table), bool)"
    return tuple(Broken(f"{module}:{form}.mask", statement) for form in forms)


PACKED = ("ply.inria", "ply.compressed", "splat", "spz.file", "sog.file", "gltf.file", "npz")
FEATURES: dict[str, tuple[Broken, ...]] = {
    "formats in": opened(*PACKED, "ksplat", "mesh"),
    "formats out": written(*PACKED),
    "LOD bundles, HTML and voxel export": (
        Broken("gsedit.toolkit.decimate:lod_tables", "yield from [table] * levels; return"),
        Broken("gsedit.pictures.viewer.browser:write_page", "return"),
    ),
    "extra columns, comments, elements kept": (
        Broken("gsedit.formats.ply.inria:beside", "return {}"),
        Broken("gsedit.formats.npz:_is_element", "return False"),
        Broken("gsedit.formats.registry:lost", "return []"),
    ),
    "filter NaN": (
        Broken("gsedit.toolkit.defects:invalid", "return {}"),
        Broken("gsedit.toolkit.repair:repaired", "return table"),
    ),
    "by value, opacity": (
        *masked("values", "Compare", value="ones"),
        Broken("gsedit.select.values:Column.of"),
    ),
    "box, sphere": (
        *(
            Broken(
                f"gsedit.select.volumes:{form}",
                "return Inside(lambda points: np.zeros(len(points), bool))",
            )
            for form in ("box", "sphere", "oriented_box", "ellipsoid", "cylinder", "half_space")
        ),
        Broken(
            "gsedit.select.volumes:_along",
            "return points - np.array(center, np.float32)",
        ),
    ),
    "inside a mesh": masked("inside_mesh", "InsideMesh"),
    "color near a picked one": (
        *masked("near_color", "NearColor"),
        Broken("gsedit.select.values:_pixel", "return 0.5, 0.5, 0.5"),
    ),
    "by masks on pictures, by visibility": (*masked("seen", "Seen", value="ones"),),
    "clusters, grow, shrink": (
        *masked("clusters", "Clusters", value="ones"),
        Broken("gsedit.select.clusters:Grown.mask", "return self.inner.mask(table)"),
        Broken("gsedit.select.clusters:Shrunk.mask", "return self.inner.mask(table)"),
    ),
    "floaters": (
        Broken("gsedit.toolkit.find_defects:floaters", "return np.zeros(len(table), bool)"),
        Broken("gsedit.toolkit.clean:mark_unseen", "return"),
    ),
    "needles, giants": tuple(
        Broken(f"gsedit.toolkit.find_defects:{kind}", "return np.zeros(len(table), bool)")
        for kind in ("needles", "giants")
    ),
    "counts and dry run": (
        Broken("gsedit_cli.core.process:write", "output = type(output)(output.out, output.force)"),
    ),
    "transform incl. SH": (
        Broken("gsedit.scene.similarity:Similarity.table", "return table"),
        Broken("gsedit.scene.quaternions:rotate_sh", "return sh"),
    ),
    "mirror": (Broken("gsedit.toolkit.steps:mirror", "return turned(np.eye(3))"),),
    "move a selection": (
        Broken("gsedit.toolkit.transform:moved_rows", "return table"),
        Broken("gsedit.toolkit.transform:moved_rows", "inside = np.ones_like(inside)"),
    ),
    "align: ground, length, another scene": (
        Broken("gsedit.toolkit.align:AlignToGround.find", "return IDENTITY"),
        Broken("gsedit.toolkit.align:AlignLength.find", "return IDENTITY"),
        Broken(
            "gsedit.toolkit.registration:register",
            "return Match(IDENTITY, 0.0, 1.0)",
        ),
    ),
    "merge, Morton order": (
        Broken("gsedit.toolkit.merge:Merge.blocks", "yield from blocks; return"),
        Broken("gsedit.scene.morton:morton_order", "return np.arange(len(means))"),
    ),
    "SH reduction": (
        Broken("gsedit.toolkit.reduce_sh:ReduceSH.apply", "return table"),
        Broken("gsedit.toolkit.reduce_sh:Lost.add", "return"),
    ),
    "decimate, LOD": (
        Broken("gsedit.toolkit.decimate:fewer", "return table"),
        Broken("gsedit.toolkit.decimate:fewer", "method = 'random'"),
        Broken("gsedit.toolkit.picture_change:picture_change", "return float('inf')"),
    ),
    "recolor": (
        Broken("gsedit.toolkit.color_maps:mapped", "return sh"),
        Broken("gsedit.toolkit.recolor:recolored", "inside = np.ones_like(inside)"),
    ),
    "palette, style from a picture": (
        Broken("gsedit.toolkit.palette:Palette.apply", "return table"),
        Broken("gsedit.editing.style.studio:Studio.with_colors", "return scene"),
        Broken("gsedit.editing.style.studio:Studio.with_texture", "yield scene; return"),
    ),
    "background removal": masked("middle", "InTheMiddle", value="ones"),
    "statistics": (
        Broken("gsedit.toolkit.scene_summary:summarise"),
        Broken("gsedit.pictures.histograms:plot_histograms", "return"),
    ),
    "compare two scenes": (
        Broken("gsedit.toolkit.differences:compare_pictures"),
        Broken("gsedit.toolkit.differences:match", "b = a"),
    ),
    "image from a camera": (
        Broken("rasterizer.render:_composed", "features = 0 * features"),
        Broken("gsedit.pictures.exr:write_exr", "return"),
    ),
    "depth, normals, alpha": (
        Broken("gsedit.pictures.maps:_facing", "return torch.eye(3)[2].expand(len(scene), 3)"),
        Broken("gsedit.pictures.maps:normal_map"),
        Broken("gsedit.pictures.exr:write_exr", "return"),
    ),
    "camera paths, video": (
        Broken("gsedit.pictures.animations:write_gif", "return"),
        Broken("gsedit.pictures.animations:write_mp4", "return"),
        Broken("gsedit.pictures.maps:wipe", "share = 1.0"),
        Broken("gsedit.cameras.paths:turntable", "return (circle.at(0.0),) * frames"),
        Broken("gsedit.cameras.paths:spline", "return tuple(cameras[:1]) * frames"),
    ),
    "point preview": (Broken("gsedit.pictures.viewer.drawing:attribute"),),
    "web viewer": (
        Broken("gsedit.pictures.viewer.browser:write_page", "return"),
        Broken("gsedit.pictures.viewer.browser:_fill", "return {}"),
    ),
    "notebooks": (Broken("rasterizer.notebook:scene_png", "return None"),),
    "train from COLMAP": (
        Broken("gsedit.fitting.fit:fit_steps"),
        Broken("gsedit.datasets.colmap:read_colmap"),
    ),
    "text edit": (
        Broken("gsedit.editing.edit:edit_steps"),
        Broken("gsedit.words.asked:looks_asked", "sentence = 'as bronze'"),
    ),
    "Python API": (Broken("gsedit.toolkit.operation:apply", "return scene"),),
    "resume": (
        Broken("gsedit.editing.session.state:restore", "return"),
        Broken("gsedit.fitting.optimizer:SceneOptimizer.load_state", "return"),
    ),
    "streaming large files": (
        Broken("gsedit.formats.ply.records:element_blocks", "at_once = 1 << 40"),
    ),
    "error messages": (
        Broken("gsedit.formats.validity:Guard.check", "return"),
        Broken("gsedit.formats.splat:open_source", "raise ValueError"),
    ),
}
"""By the first cell of its row: each function must be needed by one of the row's tests."""


def tests_of_rows() -> dict[str, list[str]]:
    """The tests that each row of the page names; none where gsedit has no such feature."""
    rows = re.findall(r"^\| (.+?) \|.*\| ([^|]*) \|$", (ROOT / PAGE).read_text(), re.MULTILINE)
    named = {feature: re.findall(r"`(tests/[^`]+)`", cell) for feature, cell in rows}
    return {feature: tests for feature, tests in named.items() if tests}


def place(function: str) -> tuple[Path, ast.FunctionDef]:
    """The file of a function, and its definition. Raises LookupError where there is none."""
    module, _, name = function.partition(":")
    first, *rest = module.split(".")
    path = ROOT.joinpath(PACKAGES.get(first, first), *rest).with_suffix(".py")
    found = ast.parse(path.read_text())
    for part in name.split("."):
        kinds = (ast.FunctionDef, ast.ClassDef)
        inside = [n for n in found.body if isinstance(n, kinds) and n.name == part]
        if not inside:
            raise LookupError(f"{function}: {path} has no {part}")
        found = inside[-1]
    assert isinstance(found, ast.FunctionDef), function
    return path.relative_to(ROOT), found


def broken_text(text: str, function: ast.FunctionDef, statement: str) -> str:
    """The source with a statement before the first of a function."""
    lines = text.splitlines(keepends=True)
    first = function.body[0]
    at = first.end_lineno if ast.get_docstring(function) is not None else first.lineno - 1
    lines.insert(at or 0, f"{' ' * first.col_offset}{statement}\n")
    return "".join(lines)


def copied_tree(target: Path) -> None:
    """Copy the files that git knows, and name the command line's package as its wheel does."""
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=True)
    for name in filter(None, listed.stdout.decode().split("\0")):
        (target / name).parent.mkdir(parents=True, exist_ok=True)
        (target / name).write_bytes((ROOT / name).read_bytes())
    for name, folder in PACKAGES.items():
        (target / name).symlink_to(folder)


def fails(tree: Path, tests: list[str]) -> bool:
    """Whether a test fails in the tree, in a child that has the large libraries already."""
    child = os.fork()
    if not child:
        os.chdir(tree)
        sys.path[:0] = [str(tree), str(tree / "examples")]
        os.environ["PYTHONPATH"] = f"{tree}:{tree / 'examples'}"
        with Path(os.devnull).open("w") as nowhere:
            os.dup2(nowhere.fileno(), 1)
            os.dup2(nowhere.fileno(), 2)
            os._exit(pytest.main(["-x", "-p", "no:cacheprovider", "-o", PLAIN, *tests]))
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    if code not in (0, 1):
        raise RuntimeError(f"pytest ended with {code}: {' '.join(tests)}")
    return code == 1


def main(features: list[str]) -> int:
    """Break the features, all or the named ones; 1 where the tests of one pass.

    Raises RuntimeError where they fail in the whole tree.
    """
    tests, passing = tests_of_rows(), 0
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder).resolve() / "tree"
        copied_tree(tree)
        compileall.compile_dir(tree, quiet=2)
        sys.dont_write_bytecode = True  # a file may be broken twice within the second of its time
        for library in LIBRARIES:
            import_module(library)
        for feature in features or tests:
            if fails(tree, tests[feature]):
                raise RuntimeError(f"{feature}: its tests fail in the whole tree")
            for each in FEATURES[feature]:
                start, (path, definition) = time.monotonic(), place(each.function)
                whole = (tree / path).read_text()
                (tree / path).write_text(broken_text(whole, definition, each.statement))
                failed = fails(tree, tests[feature])
                (tree / path).write_text(whole)
                passing += not failed
                said = "fails" if failed else "PASSES"
                seconds = f"{time.monotonic() - start:.0f} s"
                sys.stdout.write(
                    f"{said}\t{feature}\t{each.function}\t{each.statement}\t{seconds}\n"
                )
                sys.stdout.flush()
    return 1 if passing else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
