"""How good the editor `small` is, on scenes and sentences that it was not trained on.

python examples/score_small.py out/small/small.safetensors -o out/small/score

writes scores.jsonl (a line a picture), scores.md (the tables of the model card) and sheets to look
at. With --scene, a scene that was fitted to the photos of --data, it is also examined on those; the
subject is what stands in a column about where the cameras look (--radius, --lowest: world units;
1.6 and -0.57 hold the bear of Instruct-NeRF2NeRF).
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path

import torch
from torch import Tensor

import gsedit
from gsedit.consistency.correspond import correspond
from gsedit.diffusion import SamplerSettings
from gsedit.editors import EditBatch, Editor, make_editor
from gsedit.files import load_dataset
from gsedit.files.pictures import as_picture, save_picture
from gsedit.measures.metrics import edit_strength, warp_error
from gsedit.reports.json_lines import write_line
from gsedit.synthetic import demo_scene, ring_cameras
from gsedit.views.dataset import evenly_spaced
from train_small import Case, Score, Sources, summary
from train_small.captured import Column, captured, looked_at, mean_up
from train_small.phrases import held_out_pair, held_out_prompts
from train_small.pictures import procedural
from train_small.scoring import score
from train_small.target_edits import TRUTHS, edited

SEED = 9000  # the training's pictures are 1000 and up, one a chunk
SETTINGS = SamplerSettings()
PROMPTS, PICTURES, PAIRS, PHOTOS = 3, 2, 24, 4
COLUMNS = 13
CONSENSUS = ("bronze", "red", "snow", "night", "autumn", "sketch")


def single_cases() -> Iterator[Case]:
    """Every look in held-out words, each on pictures of its own."""
    generator = torch.Generator().manual_seed(SEED)
    pictures = procedural(PICTURES * PROMPTS * len(TRUTHS), 128, generator)
    for i, (name, k) in enumerate(product(TRUTHS, range(PROMPTS))):
        index = torch.arange(PICTURES) + PICTURES * i
        yield Case(pictures.rows(index), (name,), held_out_prompts((name,))[k])


def pair_cases() -> Iterator[Case]:
    """Looks that were never asked for together."""
    generator = torch.Generator().manual_seed(SEED + 1)
    pictures = procedural(PICTURES * PAIRS, 128, generator)
    subject = [name for name, truth in TRUTHS.items() if truth.scope == "subject"]
    scene = [name for name, truth in TRUTHS.items() if truth.scope == "scene"]
    pairs = [pair for pair in product(subject, scene) if held_out_pair(*pair)]
    for i, pair in enumerate(pairs[:: len(pairs) // PAIRS][:PAIRS]):
        index = torch.arange(PICTURES) + PICTURES * i
        yield Case(pictures.rows(index), pair, held_out_prompts(pair)[0])


def photo_cases(sources: Sources) -> Iterator[Case]:
    """Every look on all the photos."""
    for name in TRUTHS:
        yield Case(sources, (name,), held_out_prompts((name,))[0])


def consensus_table(editor: Editor) -> Iterator[str]:
    """Four views of the demo scene: how far they contradict each other, and how strongly edited."""
    scene = demo_scene()
    cameras = ring_cameras(scene, 12, 256)[:4]
    seen = [scene.trace(camera) for camera in cameras]
    images = torch.stack([view.image for view in seen]).float()
    depths = torch.stack([view.depth for view in seen]).float()
    alphas = torch.stack([view.alpha for view in seen]).float()
    found = correspond(cameras, depths, alphas, cell=editor.cell)
    yield "| look | consensus | disagreement (RMSE) | edit strength (RMSE) | s |"
    yield "|---|---|---|---|---|"
    for name in CONSENSUS:
        prompt = held_out_prompts((name,))[0]
        for together in (False, True):
            settings = replace(SETTINGS, consensus=together)
            batch = EditBatch(images, images, prompt, found if together else None)
            began = time.perf_counter()
            *_, last = editor.edit(batch, settings, torch.Generator().manual_seed(0))
            seconds = time.perf_counter() - began
            assert last.images is not None
            error = warp_error(last.images, cameras, depths, alphas).mean
            strength = edit_strength(images, last.images)
            told = "yes" if together else "no"
            yield f"| {name} | {told} | {error:.4f} | {strength:.3f} | {seconds:.1f} |"


def examine(editor: Editor, name: str, cases: Iterable[Case], folder: Path) -> str:
    """A row of the table; the scores and a sheet go to the folder."""
    scores, failed = list[Score](), list[str]()
    with (folder / "scores.jsonl").open("a") as file:
        for each in score(editor, cases, SETTINGS):
            scores.append(each)
            line = {"set": name, "right": each.right, **each._asdict()}
            write_line(file, line)
            if not each.right:
                failed.append(f"{' + '.join(each.names)} -> {' + '.join(each.nearest)}")
    s = summary(scores)
    kept = "" if s.kept is None else f"{s.kept:.1f}"
    (folder / f"{name.split()[0]}_failed.json").write_text(json.dumps(failed, indent=1))
    return f"| {name} | {s.count} | {s.nearest:.1%} | {s.gain:+.1f} | {kept} | {s.seconds:.2f} |"


def sheet(editor: Editor, sources: Sources, names: Sequence[str], path: Path) -> None:
    """Unedited, edited and true pictures, one under the other."""
    rows: list[Tensor] = []
    for i, name in enumerate(names):
        one = sources.rows(torch.tensor([i % len(sources.image)]))
        batch = EditBatch(one.image, one.image, held_out_prompts((name,))[0])
        *_, last = editor.edit(batch, SETTINGS, torch.Generator().manual_seed(0))
        assert last.images is not None
        rows.append(torch.cat((one.image[0], last.images[0], edited(one, (name,))[0])))
    rows += [torch.ones_like(rows[0])] * (-len(rows) % COLUMNS)
    lines = [torch.cat(rows[i : i + COLUMNS], 1) for i in range(0, len(rows), COLUMNS)]
    save_picture(as_picture(torch.cat(lines)), path, overwrite=True)


def photos(scene: Path, data: Path, radius: float, lowest: float) -> Sources:
    """Evenly spread photos with the fitted scene's geometry."""
    found = load_dataset(data, size=256)
    cameras = [view.camera for view in found.views]
    column = Column(looked_at(cameras), mean_up(cameras), radius, lowest)
    views = [found.views[i] for i in evenly_spaced(len(found), PHOTOS)]
    return captured(gsedit.load(scene).detach(), views, column)


def main(arguments: Sequence[str] | None = None) -> None:
    told = argparse.ArgumentParser(description=__doc__)
    told.add_argument("weights", type=Path)
    told.add_argument("-o", "--out", type=Path, required=True)
    told.add_argument("--scene", type=Path)
    told.add_argument("--data", type=Path)
    told.add_argument("--radius", type=float)
    told.add_argument("--lowest", type=float)
    asked = told.parse_args(arguments)
    place = (asked.scene, asked.data, asked.radius, asked.lowest)
    if None in place and any(each is not None for each in place):
        told.error("--scene, --data, --radius and --lowest belong together")
    folder = asked.out
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "scores.jsonl").unlink(missing_ok=True)
    editor = make_editor("small", model=asked.weights)
    lines = [
        "| set | edits | nearest look | gain, dB | kept, dB | s an edit |",
        "|---|---|---|---|---|---|",
    ]
    lines.append(examine(editor, "looks", single_cases(), folder))
    lines.append(examine(editor, "pairs of looks", pair_cases(), folder))
    shown = procedural(2 * COLUMNS, 128, torch.Generator().manual_seed(SEED + 2))
    sheet(editor, shown, tuple(TRUTHS), folder / "looks.png")
    if asked.scene:
        sources = photos(*place)
        lines.append(examine(editor, "photos", photo_cases(sources), folder))
        sheet(editor, sources, tuple(TRUTHS), folder / "photos.png")
    lines += ["", *consensus_table(editor)]
    (folder / "scores.md").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
