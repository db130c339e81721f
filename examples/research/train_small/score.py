"""Evaluate the editor `small` on pictures, prompts and pairs of looks that training never shows.

python -m research.train_small.score OUT/small.safetensors -o OUT/score

The folder gets scores.jsonl (one line per picture), scores.md (the tables of the model card) and
contact sheets. With --scene, a scene that was fitted to the photos of --data, the editor is also
evaluated on four of these photos; their subject is what lies in an upright cylinder around the
point that the cameras look at (--radius, --lowest: world units; 1.6 and -0.57 hold the bear of
Instruct-NeRF2NeRF).
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
from gsedit.datasets.dataset import evenly_spaced
from gsedit.datasets.load import load_dataset
from gsedit.diffusion.settings import SamplerSettings
from gsedit.editors import EditBatch, Editor, make_editor
from gsedit.formats.pictures import as_picture, save_picture
from gsedit.measures.metrics import rmse
from gsedit.runs.json_lines import write_line
from gsedit.synthetic import demo_scene, ring_cameras
from research.train_small.captured import UprightCylinder, captured, focus_point, mean_up
from research.train_small.evaluation import Case, Score, evaluate, summary
from research.train_small.pictures import procedural
from research.train_small.prompts import held_out_pair, held_out_prompts
from research.train_small.sources import Sources
from research.train_small.target_edits import TARGET_EDITS, target_images
from research.train_small.warp_error import warp_error

SEED = 9000  # the training pictures have seeds from 1000 up, one a chunk
SETTINGS = SamplerSettings()
PROMPTS, PICTURES = 3, 2  # per look, per prompt
PAIRS, PHOTOS = 24, 4
COLUMNS = 13  # of a contact sheet
CONSENSUS = ("bronze", "red", "snow", "night", "autumn", "sketch")


def single_cases() -> Iterator[Case]:
    """Every look in held-out prompts, each prompt on pictures of its own."""
    generator = torch.Generator().manual_seed(SEED)
    pictures = procedural(PICTURES * PROMPTS * len(TARGET_EDITS), 128, generator)
    for i, (name, k) in enumerate(product(TARGET_EDITS, range(PROMPTS))):
        index = torch.arange(PICTURES) + PICTURES * i
        yield Case(pictures.rows(index), (name,), held_out_prompts((name,))[k])


def pair_cases() -> Iterator[Case]:
    """Pairs of looks that no training prompt asks for together."""
    generator = torch.Generator().manual_seed(SEED + 1)
    pictures = procedural(PICTURES * PAIRS, 128, generator)
    subject = [name for name, edit in TARGET_EDITS.items() if edit.scope == "subject"]
    scene = [name for name, edit in TARGET_EDITS.items() if edit.scope == "scene"]
    pairs = [pair for pair in product(subject, scene) if held_out_pair(*pair)]
    for i, pair in enumerate(pairs[:: len(pairs) // PAIRS][:PAIRS]):
        index = torch.arange(PICTURES) + PICTURES * i
        yield Case(pictures.rows(index), pair, held_out_prompts(pair)[0])


def photo_cases(sources: Sources) -> Iterator[Case]:
    """Every look on all the photos."""
    for name in TARGET_EDITS:
        yield Case(sources, (name,), held_out_prompts((name,))[0])


def consensus_table(editor: Editor) -> Iterator[str]:
    """Four views of the demo scene, with and without consensus: their disagreement (warp error) and
    edit strength."""
    scene = demo_scene()
    cameras = ring_cameras(scene, 12, 256)[:4]
    traces = [scene.trace(camera) for camera in cameras]
    images = torch.stack([trace.image for trace in traces]).float()
    depths = torch.stack([trace.depth for trace in traces]).float()
    alphas = torch.stack([trace.alpha for trace in traces]).float()
    matches = correspond(cameras, depths, alphas, cell=editor.cell)
    yield "| look | consensus | disagreement (RMSE) | edit strength (RMSE) | s |"
    yield "|---|---|---|---|---|"
    for name in CONSENSUS:
        prompt = held_out_prompts((name,))[0]
        for consensus in (False, True):
            settings = replace(SETTINGS, consensus=consensus)
            batch = EditBatch(images, images, prompt, matches if consensus else None)
            began = time.perf_counter()
            *_, last = editor.edit(batch, settings, torch.Generator().manual_seed(0))
            seconds = time.perf_counter() - began
            assert last.images is not None
            error = warp_error(last.images, cameras, depths, alphas).mean
            strength = rmse(last.images, images)
            yes_no = "yes" if consensus else "no"
            yield f"| {name} | {yes_no} | {error:.4f} | {strength:.3f} | {seconds:.1f} |"


def table_row(editor: Editor, name: str, cases: Iterable[Case], folder: Path) -> str:
    """Evaluate; a row of the table. The scores and the list of failures go to the folder."""
    scores, failed = list[Score](), list[str]()
    with (folder / "scores.jsonl").open("a") as file:
        for each in evaluate(editor, cases, SETTINGS):
            scores.append(each)
            line = {"set": name, "right": each.correct, **each._asdict()}
            write_line(file, line)
            if not each.correct:
                failed.append(f"{' + '.join(each.names)} -> {' + '.join(each.nearest)}")
    s = summary(scores)
    kept = "" if s.kept is None else f"{s.kept:.1f}"
    (folder / f"{name.split()[0]}_failed.json").write_text(json.dumps(failed, indent=1))
    return f"| {name} | {s.count} | {s.nearest:.1%} | {s.gain:+.1f} | {kept} | {s.seconds:.2f} |"


def sheet(editor: Editor, sources: Sources, names: Sequence[str], path: Path) -> None:
    """Write a contact sheet: unedited, edited and target picture, one under the other."""
    rows: list[Tensor] = []
    for i, name in enumerate(names):
        one = sources.rows(torch.tensor([i % len(sources.image)]))
        batch = EditBatch(one.image, one.image, held_out_prompts((name,))[0])
        *_, last = editor.edit(batch, SETTINGS, torch.Generator().manual_seed(0))
        assert last.images is not None
        rows.append(torch.cat((one.image[0], last.images[0], target_images(one, (name,))[0])))
    rows += [torch.ones_like(rows[0])] * (-len(rows) % COLUMNS)
    lines = [torch.cat(rows[i : i + COLUMNS], 1) for i in range(0, len(rows), COLUMNS)]
    save_picture(as_picture(torch.cat(lines)), path, overwrite=True)


def photos(scene: Path, data: Path, radius: float, lowest: float) -> Sources:
    """Evenly spaced photos with the fitted scene's geometry."""
    dataset = load_dataset(data, size=256)
    cameras = [view.camera for view in dataset.views]
    subject = UprightCylinder(focus_point(cameras), mean_up(cameras), radius, lowest)
    views = [dataset.views[i] for i in evenly_spaced(len(dataset), PHOTOS)]
    return captured(gsedit.load(scene).detach(), views, subject)


def parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    """Exits with a message if only some of the options for photos are given."""
    parser = argparse.ArgumentParser(
        prog="research.train_small.score",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("weights", type=Path, help="file of weights")
    parser.add_argument("-o", "--out", type=Path, required=True, help="folder for the scores")
    parser.add_argument("--scene", type=Path, help="scene fitted to the photos")
    parser.add_argument("--data", type=Path, help="dataset of the photos")
    parser.add_argument("--radius", type=float, help="of the subject's cylinder")
    parser.add_argument("--lowest", type=float, help="its lower end, from the focus point")
    options = parser.parse_args(arguments)
    photo_options = (options.scene, options.data, options.radius, options.lowest)
    if None in photo_options and any(each is not None for each in photo_options):
        parser.error("--scene, --data, --radius and --lowest belong together")
    return options


def main(arguments: Sequence[str] | None = None) -> None:
    options = parse(arguments)
    folder = options.out
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "scores.jsonl").unlink(missing_ok=True)
    editor = make_editor("small", model=options.weights)
    lines = [
        "| set | edits | nearest look | gain, dB | kept, dB | s an edit |",
        "|---|---|---|---|---|---|",
    ]
    lines.append(table_row(editor, "looks", single_cases(), folder))
    lines.append(table_row(editor, "pairs of looks", pair_cases(), folder))
    pictures = procedural(2 * COLUMNS, 128, torch.Generator().manual_seed(SEED + 2))
    sheet(editor, pictures, tuple(TARGET_EDITS), folder / "looks.png")
    if options.scene:
        sources = photos(options.scene, options.data, options.radius, options.lowest)
        lines.append(table_row(editor, "photos", photo_cases(sources), folder))
        sheet(editor, sources, tuple(TARGET_EDITS), folder / "photos.png")
    lines += ["", *consensus_table(editor)]
    (folder / "scores.md").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
