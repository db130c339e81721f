"""Tables of the report and of docs/measurements/paper.md, from summary.json alone."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gsedit.bench.results import markdown_table

Numbers = Mapping[str, Any]


def tables(summary: Numbers) -> dict[str, str]:
    """Markdown by the name that docs/measurements/paper.md has between its markers."""
    found = {"conditions": conditions(summary)}
    if summary["editors"]:
        found["speed-up"] = speed_up_table(summary)
        found["strategies"] = strategies_table(summary)
        found["combined"] = combined_table(summary)
    for name, columns in SWEEPS.items():
        if name in summary["studies"]:
            found[name] = study_table(summary["studies"][name], columns)
    return found


def conditions(summary: Numbers) -> str:
    """Describe the conditions of the runs in a sentence."""
    size, costs = summary["size"], summary["costs"]
    compared = summary["studies"].get("strategies", {"seeds": [], "scenes": []})
    threads = ", ".join(map(str, summary["threads"]))
    skipped = f" {summary['skipped']}" if summary["skipped"] else ""
    quick = " --quick" if size["name"] == "quick" else ""
    return (
        f"{summary['runs']} runs of `python -m research.paper{quick}`: "
        f"scenes {', '.join(compared['scenes'])}; {len(compared['seeds'])} seeds; views of "
        f"{size['pixels']} pixels, {size['gaussians']} Gaussians, {size['views']} cameras, every "
        f"eighth held out; {size['iterative_steps']} steps of iterative, {size['further_steps']} "
        f"further ones of combined (the paper: 3000 and 800). {'; '.join(summary['machines'])}; "
        f"{threads} thread a run; {' to '.join(summary['dates'])}; commit "
        f"{', '.join(summary['commits'])}. The costly editor takes "
        f"{costs['costly_evaluation_seconds']:g} s an evaluation; an error is reached at "
        f"{costs['as_good_factor']:g} times iterative's final one (RMSE).{skipped}"
    )


def speed_up_table(summary: Numbers) -> str:
    """How much sooner each strategy reaches iterative's final error; a row an editor and arm."""
    head = ("editor: strategy", "measured", "costly editor", "paper's costs", "reached",
            "scene by scene, costly: median (lowest to highest)")  # fmt: skip
    rows = []
    for editor, numbers in summary["editors"].items():
        regimes = numbers["speed_up"]
        for label, costly in regimes["costly"].items():
            scenes = costly["scenes"]
            reached = sum(scene["reached"] for scene in scenes.values())
            pairs = sum(scene["count"] for scene in scenes.values())
            each = "; ".join(
                f"{name} {_times(s['median'])} ({_times(s['low'])} to {_times(s['high'])})"
                for name, s in scenes.items()
            )
            factors = [
                _times(regimes[regime][label]["median_scene"])
                for regime in ("measured", "costly", "paper")
            ]
            rows.append((f"{editor}: {label}", *factors, f"{reached} of {pairs}", each))
    return markdown_table(head, rows)


def strategies_table(summary: Numbers) -> str:
    """Final error and what it cost; a row an editor, scene and arm."""
    head = ("editor, scene: strategy", "final error, dB", "editor calls", "evaluations",
            "fitting steps", "seconds, measured", "hours, costly editor")  # fmt: skip
    rows = []
    each = summary["costs"]["costly_evaluation_seconds"]
    for editor, scenes in summary["studies"]["strategies"]["by_scene"].items():
        for scene, arms in scenes.items():
            for label, m in arms.items():
                if not m["final_db"]["count"]:
                    continue
                fitting = m["seconds"]["mean"] - m["editing_seconds"]["mean"]
                hours = (fitting + each * m["evaluations"]["mean"]) / 3600
                counts = [f"{m[name]['mean']:.0f}" for name in ("calls", "evaluations", "steps")]
                rows.append(
                    (f"{editor}, {scene}: {label}", _spread(m["final_db"], 1), *counts,
                     _spread(m["seconds"], 1), f"{hours:.2f}")
                )  # fmt: skip
    return markdown_table(head, rows)


def combined_table(summary: Numbers) -> str:
    """The combined experiment; a row an editor."""
    head = ("editor", "further steps after the single pass", "steps from scratch", "reached",
            "final error against iterative's, dB")  # fmt: skip
    rows = []
    for editor, numbers in summary["editors"].items():
        c = numbers["combined"]
        if c["pairs"]:
            rows.append(
                (editor, _median(c["further_steps"]), _median(c["steps_from_scratch"]),
                 f"{c['reached']} of {c['pairs']}", _spread(c["final_gain_db"], 1, sign="+"))
            )  # fmt: skip
    return markdown_table(head, rows)


COLUMNS: dict[str, tuple[str, int]] = {
    "final_db": ("edited scene to the exact edit, dB", 1),
    "target_db": ("edited pictures to the exact edit, dB", 1),
    "disagreement": ("edited pictures differ between near views, RMSE", 3),
    "target_sharpness": ("sharpness of edited pictures", 2),
    "sharpness": ("sharpness of the edited scene", 2),
    "matched": ("matched cells", 2),
    "calls": ("editor calls", 0),
    "steps": ("fitting steps", 0),
}
"""Title and digits of the columns of sweeps."""
_PICTURES = (
    "final_db", "target_db", "disagreement", "target_sharpness", "sharpness", "matched",
)  # fmt: skip
SWEEPS = {
    "t-end": _PICTURES,
    "consensus": _PICTURES,
    "visibility": _PICTURES,
    "views": ("final_db", "target_db", "disagreement", "calls", "steps"),
    "loss": ("final_db", "sharpness", "disagreement"),
    "tuning": ("final_db", "calls", "steps"),
}


def study_table(study: Numbers, columns: tuple[str, ...]) -> str:
    """A row an arm; mean and standard deviation over scenes and seeds."""
    head = ("", *(COLUMNS[name][0] for name in columns))
    rows = [
        (label, *(_spread(metrics[name], COLUMNS[name][1]) for name in columns))
        for arms in study["editors"].values()
        for label, metrics in arms.items()
        if metrics["final_db"]["count"]
    ]
    return markdown_table(head, rows)


def _spread(numbers: Numbers, digits: int, sign: str = "") -> str:
    """Mean ± standard deviation."""
    if numbers["mean"] is None:
        return ""
    text = f"{numbers['mean']:{sign}.{digits}f}"
    deviation = numbers["deviation"]
    return text if not deviation or not digits else f"{text} ± {deviation:.{digits}f}"


def _median(numbers: Numbers) -> str:
    """Median (lowest to highest)."""
    if numbers["median"] is None:
        return "not reached"
    return f"{numbers['median']:.0f} ({numbers['low']:.0f} to {numbers['high']:.0f})"


def _times(factor: float | None) -> str:
    """A speed-up; 0 is one that was not reached."""
    if factor is None:
        return ""
    return "not reached" if factor == 0 else f"{factor:.1f}x" if factor < 10 else f"{factor:.0f}x"


def write_tables(text: str, found: Mapping[str, str]) -> str:
    """The text with what stands between each pair of markers replaced by the table of that name.

    A pair is `<!-- NAME -->` and `<!-- end NAME -->`, each on a line of its own.
    """
    for name, table in found.items():
        text = _replaced(text, name, table)
    return text


def _replaced(text: str, name: str, table: str) -> str:
    begin, end = f"<!-- {name} -->\n", f"<!-- end {name} -->"
    head, found, rest = text.partition(begin)
    _, closed, tail = rest.partition(end)
    return f"{head}{begin}\n{table}\n\n{end}{tail}" if found and closed else text
