"""Tables of the report and of docs/measurements/paper.md, from summary.json alone."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import combinations, product
from typing import Any

from gsedit.bench.results import markdown_table
from research.paper.arms import (
    COMBINED,
    FACTORS,
    ITERATIVE,
    PAPER,
    T_END_STEPS,
    base_of,
    corner_label,
    t_end_label,
)
from research.paper.claims import difference, gathered, in_words
from research.paper.statistics import spread
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
    """Markdown by the name that docs/measurements/paper.md has between its markers."""
    labels = list(dict.fromkeys(row["arm"] for row in summary["rows"]))
    t_end = [t_end_label(steps) for steps in T_END_STEPS]
    changed = {
        preset: [a for a in labels if a.startswith(f"{preset}: ") and a not in t_end]
        for preset in ("paper", "default")
    }
    found = {
        "conditions": conditions(summary),
        "plan": summary["plan"],
        "paper-arms": changes_table(summary, changed["paper"]),
        "default-arms": changes_table(summary, changed["default"]),
        "strategies": arms_table(summary, [PAPER, "default", ITERATIVE, *_baselines(labels)]),
        "speed-up": speed_up_table(summary),
        "t-end": arms_table(summary, t_end),
        "factorial": factorial_table(summary),
    }
    return {name: text or NOT_RUN for name, text in found.items()}


def _baselines(labels: Sequence[str]) -> list[str]:
    return [each for each in labels if each in (COMBINED, f"{ITERATIVE}, shared noise")]


def conditions(summary: Numbers) -> str:
    """Describe the conditions of the runs, and what did not run."""
    size, costs = summary["size"], summary["costs"]
    quick = " --quick" if size["name"] == "quick" else ""
    text = (
        f"{summary['runs']} of {summary['planned']} runs of `python -m research.paper{quick}`, "
        f"{summary['cpu_hours']:.2f} processor hours: synthetic scenes of {size['gaussians']} "
        f"Gaussians, {size['views']} views of {size['pixels']} pixels, every eighth held out; "
        f"{size['iterative_steps']} steps of iterative, {size['further_steps']} further ones of "
        f"combined (the paper: 3000 and 800). {'; '.join(summary['machines'])}; "
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
    """A row an editor and arm: means and deviations over scenes and seeds."""
    rows = []
    for editor, label in product(_editors(summary), dict.fromkeys(labels)):
        group = _distinct(r for r in summary["rows"] if (r["editor"], r["arm"]) == (editor, label))
        if group:
            cells = (_spread([r[name] for r in group], COLUMNS[name][1]) for name in COLUMNS)
            rows.append((f"{editor}: {label}", str(len(group)), *cells))
    head = ("editor: arm", "runs", *(title for title, _ in COLUMNS.values()))
    return markdown_table(head, rows) if rows else ""


def changes_table(summary: Numbers, labels: Sequence[str]) -> str:
    """A row an arm and editor: what its one change does, with intervals."""
    rows = []
    for label in labels:
        base = base_of(label)
        for editor in _editors(summary) if base else ():
            cells = [_change(summary, label, base, editor, name) for name in EFFECTS]
            if any(cells):
                rows.append((f"{label}, from {base}: {editor}", *cells))
    head = ("one change", *(COLUMNS[name][0] for name in EFFECTS))
    return markdown_table(head, rows) if rows else ""


def _change(summary: Numbers, label: str, base: str | None, editor: str, name: str) -> str:
    found = change(summary, label, base or "", editor, name)
    digits = COLUMNS[name][1] + 1
    return "" if found is None else in_words(found, lambda x: f"{x:+.{digits}f}")


def change(summary: Numbers, label: str, base: str, editor: str, name: str) -> Judgement | None:
    """The difference of a metric between two arms, with one editor."""
    effects = difference(label, base, name)(summary)
    own = {scene: {editor: each[editor]} for scene, each in effects.items() if editor in each}
    return judge(own, 0.0)


def factorial_effects(summary: Numbers, name: str) -> dict[str, Judgement]:
    """The effect on a metric of each factor, and of each two together beyond both alone.

    Main effects are means over all combinations of the other factors; only scenes and seeds that
    have every combination count.
    """
    corners = list(product((True, False), repeat=len(FACTORS)))
    labels = {corner_label(on): on for on in corners}
    places: dict[tuple[str, str, int], dict[tuple[bool, ...], float]] = {}
    for row in summary["rows"]:
        if row["study"] == "factorial" and row["arm"] in labels:
            place = row["scene"], row["editor"], row["seed"]
            places.setdefault(place, {})[labels[row["arm"]]] = row[name]
    whole = {place: found for place, found in places.items() if len(found) == len(corners)}
    factors = list(FACTORS)
    sets = [(k,) for k in range(len(factors))] + list(combinations(range(len(factors)), 2))
    named = {" and ".join(factors[k] for k in each): each for each in sets}
    judged = {
        effect: judge(gathered(_contrasts(whole, each)), 0.0) for effect, each in named.items()
    }
    return {effect: found for effect, found in judged.items() if found}


def _contrasts(places: Mapping[Any, Any], factors: Sequence[int]) -> Iterator[Any]:
    """(scene, editor, contrast): the mean of the corners, with the sign of the factors' product."""
    for (scene, editor, _), corners in places.items():
        signed = [value * (-1) ** sum(not on[k] for k in factors) for on, value in corners.items()]
        yield scene, editor, 2 * sum(signed) / len(signed)


def factorial_table(summary: Numbers) -> str:
    """A row an effect."""
    found = {name: factorial_effects(summary, name) for name in EFFECTS}
    rows = [
        (effect, *(in_words(found[name][effect], _digits(name)) for name in EFFECTS))
        for effect in found["final_db"]
    ]
    head = ("with, less without", *(COLUMNS[name][0] for name in EFFECTS))
    return markdown_table(head, rows) if rows else ""


def _digits(name: str) -> Callable[[float], str]:
    return lambda x: f"{x:+.{COLUMNS[name][1] + 1}f}"


def speed_up_table(summary: Numbers) -> str:
    """How much sooner each arm reaches iterative's final error; a row an editor and arm."""
    rows = []
    shown = (PAPER, "default", COMBINED, f"{ITERATIVE}, shared noise")
    for editor, label in product(_editors(summary), shown):
        group = [r for r in summary["races"] if (r["editor"], r["arm"]) == (editor, label)]
        if group:
            reached = sum(race["measured"] > 0 for race in group)
            factors = [_times([race[r] for race in group]) for r in ("measured", "real", "paper")]
            rows.append((f"{editor}: {label}", *factors, f"{reached} of {len(group)}"))
    head = ("editor: arm", "as measured", "InstructPix2Pix here", "paper's costs", "reached")
    return markdown_table(head, rows) if rows else ""


def _times(factors: Sequence[float]) -> str:
    """Median (lowest to highest); 0 is an error that is not reached."""
    found = spread(factors)
    words = [f"{x:.2g}x" if x else "not" for x in found[2:]] if found else [""] * 3
    return f"{words[0]} ({words[1]} to {words[2]})"


def _editors(summary: Numbers) -> list[str]:
    return list(dict.fromkeys(row["editor"] for row in summary["rows"]))


def _distinct(rows: Iterator[Row]) -> list[Row]:
    """One row a scene and seed: studies share runs."""
    return list({(row["scene"], row["seed"]): row for row in rows}.values())


def _spread(values: Sequence[float | None], digits: int) -> str:
    """Mean ± standard deviation."""
    if not (numbers := spread(values)):
        return ""
    text = f"{numbers.mean:.{digits}f}"
    return f"{text} ± {numbers.deviation:.{digits}f}" if numbers.deviation and digits else text


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
