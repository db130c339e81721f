"""Every command of README.md and docs/howto, run on one scene, and the pictures that it leads to.

Run it with two versions of gsedit on the PYTHONPATH, then compare the pictures:

    python -m research.journeys OUT --scene SCENE.ply --data PHOTOS [--pages TREE]
    python -m research.journeys --compare A B -o table.csv

cameras.json lies beside SCENE. Each page has a folder of its own to work in. Files that a page
names and does not make are copies of the scene, links to the photos, or come from MADE. Two runs of
one version differ where a command is not repeatable: `gsedit mesh` is not.
"""

from __future__ import annotations

import argparse
import csv
import re
import shlex
import shutil
import subprocess
import sys
import time
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import numpy as np
from PIL import Image

ROOT = Path(__file__).parents[2]
LINE = re.compile(r"^(?: {4}|\$ )?((?:gsedit(?! is)|docker|pip|make|git) .+)", re.MULTILINE)
"""A command at the beginning of a line: in a fence, or indented."""
OTHERS = re.compile(r"^```(?!sh|bash|console|\n).*?^```", re.MULTILINE | re.DOTALL)
"""Fences of other languages."""
HELD_OUT = (4, 36, 68)
"""Views of the photos that a scene's pictures are taken from."""
SIZE = 480
LIMIT = 300.0
"""Seconds that a command may take."""
SHORTER = {"fit": ["--steps", "150", "--minutes", "60", "--force"]}
"""Options that make a verb short; a schedule by seconds would differ between two runs."""
SKIPPED = (
    (r"(?!gsedit )", "not gsedit"),
    (r"gsedit (app|mcp)\b", "a server, or about this machine"),
    (r"gsedit make\b", "longer than the limit"),
    (r"gsedit view (?!.* -o )", "needs a browser"),
    (r".*(https?://|--masks )", "needs a server, or weights"),
)
MADE = {
    "out/edit": 'edit {} "as a bronze statue" --data photos/ -o out/edit',
    "out/bronze": 'edit {} "as a bronze statue" --data photos/ -o out/bronze',
    "views.json": "metrics {} --against photos/ --save-views views.json",
    "region.npy": "select {} --region auto -o region.npy",
    "scan.obj": "mesh {} --faces 20000 -o scan.obj",
    "after.ply": "recolor {} --exposure 0.3 -o after.ply",
    "edited.ply": "recolor {} --exposure 0.3 -o edited.ply",
    "bear": "select bear.ply --at 0:120,120 --as bear",
}
"""Files that a page takes from another page, with the command that makes them."""
SCENES = (".ply", ".spz", ".splat", ".sog", ".usda")
PICTURES = (".png", ".jpg")


@dataclass
class Journey:
    """A command of a page, and how it ended."""

    page: str
    command: str
    name: str
    """Folder of its pictures."""
    exit: int | str = ""
    seconds: float = 0.0
    reason: str = ""
    """Why it was skipped, or the last line that it printed where it failed."""


NAMES = [field.name for field in fields(Journey)]


def journeys_of(tree: Path) -> list[Journey]:
    """Collect the commands of a tree's pages in order."""
    found: list[Journey] = []
    for page in [tree / "README.md", *sorted((tree / "docs/howto").glob("*.md"))]:
        for line in LINE.findall(OTHERS.sub("", page.read_text())):
            command = line if "$" in line else shlex.join(shlex.split(line, comments=True))
            slug = re.sub(r"[^a-z0-9.]+", "-", command.removeprefix("gsedit ").lower())[:80]
            again = sum(each.name.rstrip("+") == slug for each in found)
            found.append(Journey(page.stem, command, slug + "+" * again))
    return found


def run_all(out: Path, scene: Path, photos: Path, tree: Path) -> None:
    """Run the commands of all pages and write commands.csv and a folder of pictures for each."""
    journeys = journeys_of(tree)
    for index, journey in enumerate(journeys):
        work = out / "work" / journey.page
        if not work.is_dir():
            shutil.rmtree(out / "work", ignore_errors=True)
            work.mkdir(parents=True)
        run_one(journey, work, out / journey.name, scene.resolve(), photos.resolve())
        print(journey.exit, journey.seconds, journey.command, flush=True)  # noqa: T201
        write_table(out / "commands.csv", NAMES, [asdict(each) for each in journeys[: index + 1]])
    shutil.rmtree(out / "work", ignore_errors=True)


def run_one(journey: Journey, work: Path, pictures: Path, scene: Path, photos: Path) -> None:
    """Run one command, fill in how it ended, and keep its pictures and those of its scenes."""
    journey.reason = next((why for form, why in SKIPPED if re.match(form, journey.command)), "")
    if journey.reason:
        return
    words = shlex.split(journey.command)[1:]
    prepare(words, work, scene, photos)
    before = {path: path.stat().st_mtime_ns for path in files_of(work)}
    started = time.monotonic()
    journey.exit, text = gsedit([*words, *SHORTER.get(words[0], [])], work)
    journey.seconds = round(time.monotonic() - started, 1)
    if journey.exit:
        journey.reason = (text.strip().splitlines() or [""])[-1][:200]
    for path in files_of(work):
        if before.get(path) == path.stat().st_mtime_ns:
            continue
        name = re.sub(r"[^\w.]+", "-", str(path.relative_to(work)))
        if path.suffix in PICTURES:
            pictures.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(path, pictures / name)
        elif path.suffix in SCENES:
            draw(path, photos, pictures, name)


def prepare(words: list[str], work: Path, scene: Path, photos: Path) -> None:
    """Make the inputs that a command names and its page has not made."""
    for folder in ("photos", "posed"):
        if not (work / folder).exists():
            (work / folder).symlink_to(photos)
    shutil.copyfile(scene.with_name("cameras.json"), work / "cameras.json")
    for before, word in zip(["", *words], words, strict=False):
        written = before in ("-o", "--save", "--save-views", "--as")
        if written or (words[0] == "convert" and word == words[2]):
            if word not in words[1:2] and (work / word).is_file():
                (work / word).unlink()
            continue
        for name, command in MADE.items():
            if name in (word, *map(str, Path(word).parents)) and not (work / name).exists():
                gsedit(shlex.split(command.format(scene)), work)
        if re.fullmatch(r"\w+\.ply", word) and not (work / word).exists():
            shutil.copyfile(scene, work / word)
        elif re.fullmatch(r"\w+\.jpg", word):
            shutil.copyfile(min((photos / "images").iterdir()), work / word)


def gsedit(words: list[str], work: Path) -> tuple[int | str, str]:
    """Run gsedit of the PYTHONPATH in a folder; its exit code and what it printed as errors."""
    command = [sys.executable, "-m", "gsedit_cli", *words]
    try:
        done = subprocess.run(
            command, cwd=work, capture_output=True, text=True, timeout=LIMIT, check=False
        )
    except subprocess.TimeoutExpired:
        return "timeout", "longer than the limit"
    return done.returncode, done.stderr


def files_of(work: Path) -> list[Path]:
    """All files below a folder, without those that links lead to."""
    found = sorted(path for path in work.rglob("*") if path.is_file() and not path.is_symlink())
    return [path for path in found if not {"photos", "posed"} & set(path.relative_to(work).parts)]


def draw(path: Path, photos: Path, pictures: Path, name: str) -> None:
    """Draw a scene file from the held-out views, where it is a scene."""
    import gsedit

    try:
        scene = gsedit.load(path)
    except (gsedit.GseditError, ValueError):
        return  # a mesh or a cloud of points
    views = gsedit.load_dataset(photos, size=SIZE).views
    for index in HELD_OUT:
        color = gsedit.render(scene, views[index % len(views)].camera).color
        pixels = (color.clamp(0, 1) * 255).round().byte().numpy()
        pictures.mkdir(parents=True, exist_ok=True)
        Image.fromarray(pixels).save(pictures / f"{name}-{index}.png")


def compare(a: Path, b: Path, table: Path) -> None:
    """Write the dB between each two pictures, and the commands that end differently."""
    rows: list[dict[str, object]] = []
    tables = [(x / "commands.csv").read_text().splitlines() for x in (a, b)]
    ends = [{each["name"]: each["exit"] for each in csv.DictReader(table)} for table in tables]
    for name in sorted({*ends[0], *ends[1]}):
        first, second = (end.get(name, "absent") for end in ends)
        if first != second:
            rows.append({"what": name, "db": "", "note": f"exit {first} and {second}"})
    found = [pictures_of(a), pictures_of(b)]
    for name in sorted({*found[0], *found[1]}):
        if not (name in found[0] and name in found[1]):
            rows.append({"what": name, "db": "", "note": f"only in {a if name in found[0] else b}"})
        else:
            rows.append({"what": name, **difference(found[0][name], found[1][name])})
    write_table(table, ["what", "db", "note"], rows)


def pictures_of(folder: Path) -> dict[str, Path]:
    """Pictures of a run by their folder and name."""
    found = [path for path in folder.glob("*/*") if path.suffix in PICTURES]
    return {str(path.relative_to(folder)): path for path in found}


def difference(a: Path, b: Path) -> dict[str, object]:
    """PSNR of two pictures of equal size."""
    first, second = (np.asarray(Image.open(x).convert("RGB"), dtype=np.float64) for x in (a, b))
    if first.shape != second.shape:
        return {"db": "", "note": f"sizes {first.shape[:2]} and {second.shape[:2]}"}
    error = np.mean(np.square(first - second)) / 255**2
    return {"db": "inf" if error == 0 else f"{-10 * np.log10(error):.2f}", "note": ""}


def write_table(path: Path, names: list[str], rows: list[dict[str, object]]) -> None:
    """Write a CSV file."""
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, names)
        writer.writeheader()
        writer.writerows(rows)


def main() -> None:
    """Run the journeys, or compare two runs."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("out", type=Path, nargs="?")
    parser.add_argument("--scene", type=Path)
    parser.add_argument("--data", type=Path)
    parser.add_argument("--pages", type=Path, default=ROOT)
    parser.add_argument("--compare", type=Path, nargs=2)
    parser.add_argument("-o", "--output", type=Path, default=Path("table.csv"))
    given = parser.parse_args()
    if given.compare:
        compare(given.compare[0], given.compare[1], given.output)
    elif given.out and given.scene and given.data:
        run_all(given.out.resolve(), given.scene, given.data, given.pages)
    else:
        parser.error("give OUT, --scene and --data, or --compare A B")


if __name__ == "__main__":
    main()
