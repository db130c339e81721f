"""Kill long commands (`kill -9`) at random moments, run them again, and compare with whole runs.

python examples/kill_and_resume.py out/kills 10 [--photos FOLDER] [--only TEXT]

Prints a row a command: of so many kills, how many came while it worked; how many left nothing under
the output's name, a whole output, a broken one; and how many of the second runs ended well, with
which largest difference from a run that nobody killed. With --photos, capture is one of them.
"""

from __future__ import annotations

import argparse
import random
import shlex
import shutil
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import torch
from research.fit.captures import write_dataset

import gsedit
from gsedit.bench.results import markdown_table
from gsedit.datasets.cameras_json import write_cameras
from gsedit.datasets.dataset import Dataset, capture
from gsedit.synthetic import demo_scene, ring_cameras, surface_gaussians
from rasterizer.scene import Gaussians

COPIES = 200
"""Copies of a scene of 2,000 Gaussians, side by side, in the one that is converted."""
WHEN = (0.15, 0.9)
"""When a command is killed, of the seconds that it takes."""


@dataclass(frozen=True)
class Command:
    """A long command, its words with {given} and {out} for folders."""

    words: str
    output: str
    """Its result, in {out}."""
    again: str = ""
    """Words by which it continues; "": the same command begins again, or continues by itself."""


COMMANDS = {
    "edit": Command(
        "edit {given}/scene.ply gold -o {out}/edit --size 64 --batches 2 --steps 3 "
        "--loss mse+gram --update-steps 40 --checkpoint-every 0.3",
        "edit/scene.ply", "--resume",
    ),
    "fit": Command(
        "fit {given}/photos -o {out}/fit.ply --steps 200 --checkpoint-every 0.3",
        "fit.ply", "--resume",
    ),
    "make": Command("make {given}/photos gold -o {out}/make --minutes 0.05", "make/edit/scene.ply"),
    "removal": Command(
        "edit {given}/scene.ply 'remove it' -o {out}/removal --region box:0.2,-1,-1,1,1,1",
        "removal/scene.ply",
    ),
    "mesh": Command("mesh {given}/scene.ply -o {out}/mesh.glb", "mesh.glb"),
    "convert to .sog": Command("convert {given}/large.ply -o {out}/a.sog", "a.sog"),
    "convert to .spz": Command("convert {given}/large.ply -o {out}/a.spz", "a.spz"),
    "capture": Command(
        "capture {photos} -o {out}/capture --size 400", "capture/transforms.json"
    ),
}  # fmt: skip


def start(command: Command, places: dict[str, Path], more: str = "") -> subprocess.Popen[bytes]:
    """Start a command; the log of its last run is beside its output."""
    words = [word.format(**places) for word in shlex.split(command.words)]
    places["out"].mkdir(parents=True, exist_ok=True)
    with (places["out"] / "log.txt").open("wb") as log:
        own = [sys.executable, "-m", "gsedit_cli", *words, *more.split()]
        return subprocess.Popen(own, stdout=log, stderr=log)


def state_of(path: Path) -> str:
    """absent, whole or broken: whether the output can be read to its end."""
    if not path.exists():
        return "absent"
    try:
        _read(path)
    except Exception as error:
        sys.stderr.write(f"{path}: {error}\n")
        return "broken"
    return "whole"


def _read(path: Path) -> list[torch.Tensor]:
    if path.suffix == ".json":
        return [view.camera.world_to_camera for view in gsedit.load_dataset(path.parent).views]
    if path.suffix == ".glb":
        import trimesh

        return [torch.tensor(sorted(trimesh.load_mesh(path).vertices.tolist()))]
    return list(vars(gsedit.load(path)).values())


def difference(ours: Path, theirs: Path) -> float:
    """The largest of any number; infinite for another number of rows."""
    pairs = list(zip(_read(ours), _read(theirs), strict=True))
    if any(x.shape != y.shape for x, y in pairs):
        return float("inf")
    return max(float((x - y).abs().max()) for x, y in pairs)


def kills(name: str, out: Path, count: int, photos: Path | None) -> Iterator[str]:
    """Cells of a command's row."""
    command, moments = COMMANDS[name], random.Random(0)
    places = {"given": out, "photos": photos or out, "out": out / name.replace(" ", "_") / "whole"}
    began = time.monotonic()
    code = start(command, places).wait()
    seconds = time.monotonic() - began
    whole = places["out"] / command.output
    if code:
        raise SystemExit(f"{name}: {(places['out'] / 'log.txt').read_text()[-500:]}")
    states, busy, ended, parts, worst = Counter(), 0, 0, 0, 0.0
    for number in range(count):
        places["out"] = folder = out / name.replace(" ", "_") / f"killed_{number}"
        shutil.rmtree(folder, ignore_errors=True)
        process = start(command, places)
        time.sleep(moments.uniform(*WHEN) * seconds)
        busy += process.poll() is None
        process.kill()
        process.wait()
        states[state := state_of(folder / command.output)] += 1
        more = f"{command.again} {'-f' if state == 'whole' else ''}"
        good = start(command, places, more).wait() == 0
        ended += good
        if good:
            worst = max(worst, difference(folder / command.output, whole))
        parts += len(list(folder.rglob(".gs-*")))
        shutil.rmtree(folder)
    yield from (name, f"{seconds:.1f}", str(busy))
    yield from (str(states[state]) for state in ("absent", "whole", "broken"))
    yield from (f"{ended} of {count}", f"{worst:.0e}", str(parts))


def make_inputs(out: Path) -> None:
    """Write a scene with cameras, photos of it, and a large scene of its copies."""
    solid = demo_scene()
    scene = surface_gaussians(solid, 2000, torch.Generator().manual_seed(0))
    views = capture(scene, ring_cameras(solid, 16, 64), [f"{i:02d}" for i in range(16)])
    colors = (0.5 + 0.2821 * scene.sh[:, 0]).clamp(0, 1)
    write_dataset(Dataset(views, scene.means.double(), colors), out / "photos")
    aside = torch.arange(COPIES).repeat_interleave(len(scene.means))[:, None]
    values = {name: torch.cat([value] * COPIES) for name, value in vars(scene).items()}
    values["means"] = values["means"] + aside * torch.tensor([3.0, 0, 0])
    for name, made in (("scene", scene), ("large", Gaussians(**values))):
        gsedit.save(made, out / f"{name}.ply", overwrite=True)
    write_cameras(views, out / "cameras.json", overwrite=True)


def main() -> None:
    parser = argparse.ArgumentParser(description="Kill long commands, and run them again.")
    parser.add_argument("out", type=Path)
    parser.add_argument("kills", type=int)
    parser.add_argument("--photos", type=Path, help="photos whose cameras are to be found")
    parser.add_argument("--only", default="", help="a part of the commands' names")
    given = parser.parse_args()
    make_inputs(given.out)
    chosen = [
        name for name in COMMANDS
        if given.only in name and (given.photos or name != "capture")
    ]  # fmt: skip
    head = (
        "command", "s", "killed at work", "absent", "whole", "broken", "ended well again",
        "difference", "parts",
    )  # fmt: skip
    rows = []
    for name in chosen:
        rows.append(list(kills(name, given.out, given.kills, given.photos)))
        print(rows[-1], flush=True)  # noqa: T201
    print(markdown_table(head, rows))  # noqa: T201


if __name__ == "__main__":
    main()
