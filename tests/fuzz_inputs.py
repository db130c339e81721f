"""Inputs to be damaged: scenes of every format, datasets, cameras, checkpoints, meshes, edits."""

from __future__ import annotations

import json
import shutil
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from math import ceil
from pathlib import Path

import numpy as np
import torch
import trimesh
from bad_files import dataset, write
from fuzzing import (
    Damage,
    Outcome,
    any_bytes,
    in_glb,
    in_gzip,
    in_json,
    in_zip,
    in_zstd,
    judge,
    read_through,
)
from photo_sets import cameras, colmap_dataset
from PIL import Image
from splat_tables import near_grey

from gsedit import load_dataset
from gsedit.app import document
from gsedit.editing.folder import history_of
from gsedit.formats.files import write_scene
from gsedit.formats.flags import read_flags, write_flags
from gsedit.formats.ply.records import read_ply_header
from gsedit.formats.streams import SceneHeader, in_blocks
from gsedit.measures.against import resolve_reference
from gsedit.paper.editors.painter import network
from gsedit.run.state import State, load_state, save_state
from gsedit.scene.similarity import Similarity
from gsedit.scene.table import SplatTable
from gsedit.select import subject as saliency
from gsedit.select.saved import read_named, save_named
from gsedit.toolkit.transform import read_similarity, write_similarity
from gsedit.views.cameras_json import read_cameras, write_cameras
from gsedit.views.export_frame import applied_by
from gsedit.views.view_list_files import by_capture, read_view_list, write_view_list
from gsedit.views.viewpoints import Viewpoint

BYTES_MOST = 256 << 20
"""Python's memory for one of these inputs: they are a few kB."""
SCENE_BYTES_MOST = 128 << 20
"""Python's memory for a scene: blocks, pictures and decoders beside its few rows."""
TABLE = near_grey(24, 1)
TINY = Path(__file__).with_name("data") / "splats"


@dataclass(frozen=True)
class Input:
    """Files that one reader reads, one of which is damaged at a time."""

    name: str
    build: Callable[[Path], object]
    """Writes them into an empty folder."""
    damaged: tuple[str, ...]
    """Relative to the folder."""
    read: Callable[[Path], object]
    """Reads the folder, or raises."""
    inner: Damage | None = None
    """Damage below what checksums, brackets and syntax protect."""
    is_scene: bool = False
    """Its file is named in every message, it gives no warning, and takes little memory."""
    share: float = 1.0
    """Part of the times that are asked for: half a second each, where a child process reads."""


def scene(
    name: str,
    build: Callable[[Path, SplatTable], object],
    inner: Damage | None = None,
    share: float = 1.0,
) -> Input:
    """A scene file of that name."""
    return Input(
        name, lambda folder: build(folder / name, TABLE), (name,), _reader(name), inner, True, share
    )


def fuzz(subject: Input, times: int, folder: Path, seed: int = 0) -> Outcome:
    """Damage the files of an input `times` times, each repeatable by its own number."""
    subject.build(folder)
    whole = {name: (folder / name).read_bytes() for name in subject.damaged}
    outcome = Outcome()
    for index in range(ceil(times * subject.share)):
        rng = np.random.default_rng((seed, index))
        name = subject.damaged[index % len(subject.damaged)]
        inner = subject.inner is not None and rng.random() < 0.6
        damage = subject.inner if inner and subject.inner else any_bytes
        (folder / name).unlink()  # written over, ext4 would wait for the disk
        (folder / name).write_bytes(damage(whole[name], rng))
        label = f"{subject.name}: {name} {seed} {index}"
        if subject.is_scene:
            judge(folder, outcome, label, SCENE_BYTES_MOST, subject.read, name)
        else:
            judge(folder, outcome, label, BYTES_MOST, subject.read, warned="ignore")
        (folder / name).unlink()
        (folder / name).write_bytes(whole[name])
    return outcome


def _write(path: Path, table: SplatTable) -> None:
    header = SceneHeader(table.degree, {n: c.dtype for n, c in table.extra.items()})
    write_scene(path, header, in_blocks(table))


def _ascii(path: Path, table: SplatTable) -> None:
    _write(path, table)
    at = read_ply_header(path).data_offset
    raw = path.read_bytes()
    rows = np.frombuffer(raw[at:], "<f4").reshape(len(table), -1)
    text = "\n".join(" ".join(f"{v:.6g}" for v in row) for row in rows)
    path.write_bytes(raw[:at].replace(b"binary_little_endian", b"ascii") + text.encode() + b"\n")


def _folder(path: Path, table: SplatTable) -> None:
    other = path.with_name("a.sog")
    _write(other, table)
    with zipfile.ZipFile(other) as archive:
        archive.extractall(path.parent)
    other.unlink()


def viewpoints() -> list[Viewpoint]:
    return [Viewpoint(f"images/{i}.jpg", camera) for i, camera in enumerate(cameras())]


def _photos(folder: Path) -> None:
    record = dataset(folder)
    record |= {"cx": 4.0, "cy": 3.0, "k1": 0.01, "camera_model": "OPENCV", "applied_scale": 1.0}
    record["applied_transform"] = np.eye(4)[:3].tolist()
    record["frames"][0]["mask_path"] = "masks/0.png"
    (folder / "masks").mkdir()
    Image.new("L", (8, 6), 255).save(folder / "masks" / "0.png")
    write(folder, record)


def _read_photos(folder: Path) -> None:
    for view in load_dataset(folder).views:
        assert view.image.isfinite().all()
    applied_by(folder)


def _colmap(folder: Path) -> None:
    colmap_dataset(folder, "OPENCV")


def _colmap_text(folder: Path) -> None:
    colmap_dataset(folder, "SIMPLE_RADIAL", text=True)


def _read_colmap(folder: Path) -> None:
    for view in load_dataset(folder).views:
        assert view.camera.world_to_camera.isfinite().all()


def _checkpoint(folder: Path) -> None:
    tensors = {f"value.{name}": torch.ones(3, 2) for name in ("means", "sh")}
    record = {"step": 3, "settings": {"rounds": 2, "size": None}, "journal": [{"stage": "a"}]}
    save_state(State(record, tensors), folder / "a.safetensors")


def _mesh(suffix: str) -> Callable[[Path], None]:
    def build(folder: Path) -> None:
        pixels = np.arange(192, dtype=np.uint8).reshape(8, 8, 3)
        mesh = trimesh.creation.box()
        material = trimesh.visual.material.PBRMaterial(baseColorTexture=Image.fromarray(pixels))
        if suffix != ".glb":
            material = material.to_simple()
        visual = trimesh.visual.TextureVisuals(uv=mesh.vertices[:, :2], material=material)
        mesh.visual = visual if suffix in (".obj", ".glb") else mesh.visual
        mesh.export(folder / f"a{suffix}")

    return build


def _reader(name: str) -> Callable[[Path], object]:
    return lambda folder: read_through(folder / name)


def _edit(folder: Path) -> None:
    summary = {"instruction": "gold", "editor": "looks", "measured": {"strength": 0.5}}
    record = {
        "scene": str(folder / "scene.ply"), "instruction": "gold", "seed": 3,
        "editor": {"editor": "looks"}, "strategy": {"name": "a"}, "settings": {"size": 64},
        "measured": {"strength": 0.5}, "timings": {"total": 1.0}, "edited_views": ["images/0.jpg"],
        "work": {"network_evaluations": 3}, "history": [summary], "drop_invalid": False,
    }  # fmt: skip
    (folder / "scene.ply").touch()
    (folder / "edit.json").write_text(json.dumps(record))
    write_cameras(viewpoints(), folder / "cameras.json")
    event = {"stage": "a", "seconds": 1.0, "step": 1, "steps": 2}
    (folder / "metrics.jsonl").write_text(json.dumps(event) + "\n")
    write_flags(np.ones(3, bool), folder / "region.npy")


def _read_edit(folder: Path) -> None:
    history_of(folder / "scene.ply")
    resolve_reference(folder)
    read_flags(folder / "region.npy", 3)


def _session(folder: Path) -> None:
    steps = (
        document.Step("as captured", "a.ply"),
        document.Step("gold", "b.ply", ("edit", "gold")),
    )
    eye = document.Eye((0.0, 1.0, 2.0), (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 0.8)
    pending = document.Pending("bronze", ("edit", "bronze"))
    document.save(document.Document("a.ply", steps, 1, eye, pending), folder)


PICTURES = ("a.png", "a.jpg", "a.webp", "a.tif")


def _pictures(folder: Path) -> None:
    pixels = np.random.default_rng(1).integers(256, size=(40, 48, 3), dtype=np.uint8)
    for name in PICTURES:
        Image.fromarray(pixels).save(folder / name)


def _read_pictures(folder: Path) -> None:
    for name in PICTURES:
        assert network.read_style_picture(folder / name).isfinite().all()


def _weights(source: Path, load: Callable[[Path], object]) -> Input:
    """A file of weights of a published network, 0.7 to 5 MB."""
    return Input(
        source.name, lambda folder: shutil.copyfile(source, folder / source.name), (source.name,),
        lambda folder: load(folder / source.name), share=0.05,
    )  # fmt: skip


MEANS = np.arange(30, dtype=np.float32).reshape(10, 3)


def _selection(folder: Path) -> None:
    save_named(MEANS[:, 0] > 9, MEANS, folder / "a.ply", "chair")


USD_CORE = ("usda", "usdc", "usdz")
"""Suffixes that usd-core reads."""
SCENES = (
    scene("a.ply", _write),
    scene("ascii.ply", _ascii),
    scene("a.compressed.ply", _write),
    scene("a.splat", lambda path, table: _write(path, table.replace(sh=table.sh[:, :1]))),
    scene("3.spz", _write, in_gzip),
    scene("4.spz", lambda path, _: shutil.copyfile(TINY / "tiny.4.spz", path), in_zstd),
    scene("a.sog", _write, in_zip),
    scene("meta.json", _folder, in_json),
    scene("a.glb", _write, in_glb),
    *(scene(f"a.{end}", _write, share=0.02) for end in USD_CORE if find_spec("pxr")),
)
MODEL = tuple(f"sparse/0/{name}" for name in ("cameras.bin", "images.bin", "points3D.bin"))
INPUTS = (
    *SCENES,
    Input("transforms.json", _photos, ("transforms.json",), _read_photos, in_json),
    Input("colmap", _colmap, MODEL, _read_colmap),
    Input(
        "colmap text", _colmap_text, tuple(n.replace(".bin", ".txt") for n in MODEL), _read_colmap
    ),
    Input(
        "cameras.json",
        lambda folder: write_cameras(viewpoints(), folder / "cameras.json"),
        ("cameras.json",),
        lambda folder: read_cameras(folder / "cameras.json"),
        in_json,
    ),
    Input(
        "views.json",
        lambda folder: write_view_list(by_capture(viewpoints()), folder / "views.json"),
        ("views.json",),
        lambda folder: read_view_list(folder / "views.json"),
        in_json,
    ),
    Input(
        "checkpoint",
        _checkpoint,
        ("a.safetensors",),
        lambda folder: load_state(folder / "a.safetensors"),
    ),
    Input("a.obj", _mesh(".obj"), ("a.obj", "material.mtl", "material_0.png"), _reader("a.obj")),
    Input("mesh.glb", _mesh(".glb"), ("a.glb",), _reader("a.glb"), in_glb),
    *(
        Input(f"mesh{end}", _mesh(end), (f"a{end}",), _reader(f"a{end}"))
        for end in (".ply", ".stl", ".off")
    ),
    Input("edit.json", _edit, ("edit.json", "cameras.json"), _read_edit, in_json),
    Input("edit folder", _edit, ("region.npy", "metrics.jsonl"), _read_edit),
    Input("session.json", _session, ("session.json",), document.load, in_json),
    Input(
        "saved selection",
        _selection,
        ("a.regions/chair.npy",),
        lambda folder: read_named(folder / "a.regions/chair.npy", MEANS),
    ),
    Input(
        "similarity",
        lambda folder: write_similarity(Similarity(np.eye(3), 2.0, np.ones(3)), folder / "a.json"),
        ("a.json",),
        lambda folder: read_similarity(folder / "a.json"),
        in_json,
    ),
    Input("pictures", _pictures, PICTURES, _read_pictures),
    _weights(network.WEIGHTS, network.load_picture_styles.__wrapped__),
    _weights(saliency.WEIGHTS, saliency.load_network),
)
