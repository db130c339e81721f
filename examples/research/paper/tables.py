"""Tables of the report, from the summary alone."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import chain, product
from math import exp, inf
from statistics import fmean, median, stdev
from typing import Any

from gsedit.bench.results import markdown_table
from research.paper.arms import (
    DEFAULT,
    ITERATIVE,
    PAPER,
    T_END_STEPS,
    base_of,
    t_end_label,
)
from research.paper.claims import difference, in_words, log_factor, of_editor
from research.paper.summary import Row
from research.paper.verdicts import Judgement, judge

Numbers = Mapping[str, Any]
COLUMNS: dict[str, tuple[str, int]] = {
    "final_db": ("edited scene to the reference, dB", 1),
    "residual_db": ("edited scene to the edited pictures, dB", 1),
    "target_db": ("edited pictures to the exact edit, dB", 1),
    "disagreement": ("edited pictures differ between near views, RMSE", 3),
    "target_sharpness": ("sharpness of edited pictures", 2),
    "sharpness": ("sharpness of the edited scene", 2),
    "matched": ("matched cells", 2),
    "cpu": ("processor s", 0),
}
"""Title and digits of the columns of arms."""
NOT_RUN = "Not run."
EFFECTS = ("final_db", "residual_db", "disagreement", "sharpness")
"""Metrics whose change by each arm is shown."""


def tables(summary: Numbers) -> dict[str, str]:
    """Tables in Markdown, by the names of the sections."""
    labels = list(dict.fromkeys(row["arm"] for row in summary["rows"]))
    t_end = [t_end_label(steps) for steps in T_END_STEPS]
    changed = {
        preset: [a for a in labels if a.startswith(f"{preset}: ") and a not in t_end]
        for preset in ("paper", "default")
    }
    found = {
        "conditions": conditions(summary),
        "paper-arms": changes_table(summary, changed["paper"]),
        "default-arms": changes_table(summary, changed["default"]),
        "strategies": arms_table(summary, [PAPER, DEFAULT, ITERATIVE]),
        "speed-up": speed_up_table(summary),
        "t-end": arms_table(summary, t_end),
    }
    return {name: text or NOT_RUN for name, text in found.items()}


def conditions(summary: Numbers) -> str:
    """Describe the conditions of the runs, and what did not run."""
    size, costs = summary["size"], summary["costs"]
    quick = " --quick" if size["name"] == "quick" else ""
    text = (
        f"{summary['runs']} of {summary['planned']} runs of `python -m research.paper{quick}`, "
        f"{summary['cpu_hours']:.2f} processor hours: synthetic scenes of {size['gaussians']} "
        f"Gaussians, {size['views']} views of {size['pixels']} pixels, every eighth held out; "
        f"{size['iterative_steps']} steps of iterative. {'; '.join(summary['machines'])}; "
        f"{', '.join(map(str, summary['threads']))} thread a run; "
        f"{' to '.join(summary['dates'])}; commit {', '.join(summary['commits'])}. "
        f"InstructPix2Pix takes {costs['real_evaluation_seconds']:g} s an evaluation; an error is "
        f"reached at {costs['as_good_factor']:g} times iterative's final one (RMSE)."
    )
    if summary["missing"]:
        missing = ", ".join(f"{n} of {study}" for study, n in summary["missing"].items())
        text += f" Not run: {missing}."
    for run, error in summary["failed"].items():
        text += f" Failed: {run} ({error})."
    return text


def arms_table(summary: Numbers, labels: Sequence[str]) -> str:
    """A row an editor and arm, of the scenes and seeds that all these arms of the editor have."""
    rows = []
    for editor in _editors(summary):
        own = {
            label: {(r["scene"], r["seed"]): r for r in summary["rows"]
                    if (r["editor"], r["arm"]) == (editor, label)}
            for label in dict.fromkeys(labels)
        }  # fmt: skip
        made = {label: places for label, places in own.items() if places}
        shared = set.intersection(*map(set, made.values())) if len(made) > 1 else set()
        for label, places in made.items() if shared else ():
            group = [places[place] for place in sorted(shared)]
            cells = (_spread(group, name, COLUMNS[name][1]) for name in COLUMNS)
            scenes = len({scene for scene, _ in shared})
            rows.append((f"{editor}: {label}", f"{scenes}, {len(shared)}", *cells))
    head = ("editor: arm", "scenes, runs", *(title for title, _ in COLUMNS.values()))
    return markdown_table(head, rows) if rows else ""


def changes_table(summary: Numbers, labels: Sequence[str]) -> str:
    """A row an arm and editor: what its one change does, with intervals."""
    rows = []
    for label in labels:
        base = base_of(label)
        for editor in _editors(summary) if base else ():
            found = [change(summary, label, base or "", editor, name) for name in EFFECTS]
            if known := next((each for each in found if each), None):
                cells = (in_words(f, _digits(n)) if f else "" for n, f in zip(EFFECTS, found))
                counts = f"{known.scenes}, {known.runs}"
                rows.append((f"{label}, from {base}: {editor}", counts, *cells))
    head = ("one change", "scenes, pairs", *(COLUMNS[name][0] for name in EFFECTS))
    return markdown_table(head, rows) if rows else ""


def change(summary: Numbers, label: str, base: str, editor: str, name: str) -> Judgement | None:
    """The difference of a metric between two arms, with one editor."""
    return judge(of_editor(difference(label, base, name)(summary), editor), 0.0)


def _digits(name: str) -> Callable[[float], str]:
    return lambda x: f"{x:+.{COLUMNS[name][1] + 1}f}"


def speed_up_table(summary: Numbers) -> str:
    """How much sooner each arm reaches iterative's errors; a row an editor and arm."""
    rows = []
    shown = (PAPER, DEFAULT)
    for editor, label in product(_editors(summary), shown):
        group = [r for r in summary["races"] if (r["editor"], r["arm"]) == (editor, label)]
        if group:
            cells = []
            for names in (("half_real",), ("real", "measured")):
                reached = sum(race[names[0]] > 0 for race in group)
                cells += [f"{reached} of {len(group)}", *(_times(group, name) for name in names)]
            rows.append((f"{editor}: {label}", *cells))
    head = ("editor: arm", "half of the way: reached", "InstructPix2Pix here", "all: reached",
            "InstructPix2Pix here", "as measured")  # fmt: skip
    return markdown_table(head, rows) if rows else ""


def _times(races: Sequence[Row], name: str) -> str:
    """Median (lowest to highest) over scenes of the median over seeds; 0 is not reached."""
    by_scene: dict[str, list[float]] = {}
    for race in races:
        by_scene.setdefault(race["scene"], []).append(log_factor(race[name]))
    scenes = list(by_scene.values())
    found = sorted(map(median, scenes) if len(scenes) > 1 else scenes[0])
    words = [f"{exp(x):.2g}x" if x > -inf else "not" for x in (median(found), found[0], found[-1])]
    return f"{words[0]} ({words[1]} to {words[2]})"


def _editors(summary: Numbers) -> list[str]:
    return list(dict.fromkeys(row["editor"] for row in summary["rows"]))


def _spread(rows: Sequence[Row], name: str, digits: int) -> str:
    """Mean ± standard deviation over the means of scenes, or over the seeds of a single one."""
    by_scene: dict[str, list[float]] = {}
    for row in rows:
        if row[name] is not None:
            by_scene.setdefault(row["scene"], []).append(row[name])
    scenes = list(by_scene.values())
    numbers = [*(map(fmean, scenes) if len(scenes) > 1 else chain(*scenes))]
    if not numbers:
        return ""
    text, deviation = f"{fmean(numbers):.{digits}f}", stdev(numbers) if len(numbers) > 1 else 0.0
    return f"{text} ± {deviation:.{digits}f}" if deviation and digits else text
