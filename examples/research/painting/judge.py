"""Verdicts of the claims by records, the table and the figure: nothing here runs an edit."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean, geometric_mean
from typing import Any, Literal, NamedTuple

from gsedit.errors import InputError
from gsedit.measures.formulas import Interval, mean_interval
from gsedit.run.atomic import atomic_path
from research.figures import LOOKS

Row = Mapping[str, Any]
TEXTS = ("scene", "style", "arm")
METERS = ("energy", "perceptual", "gram", "likeness", "disagreement", "psnr")
BLURRED = "blurred_disagreement"
OF_TARGETS = ("target_energy", "target_disagreement", BLURRED)
FIELDS = (*TEXTS, "seed", "at", "seconds", "prepared", "steps", "edits", *METERS, *OF_TARGETS)
Verdict = Literal["seen", "in part", "not seen", "opposite seen", "not reached", "not judged"]

EDIT_PRICE, STEP_PRICE = 7.5, 0.15
"""Seconds of an edited view and of a step in the paper: 30 s for four views, 0.15 s a step."""
TENFOLD = 10.0
MOST_SECONDS, LEAST_ENERGY, MOST_PERCEPTUAL = 30.0, 0.5, 0.45
"""The quality that a painted scene is to reach, and in which time."""


def number(value: Any) -> Any:
    """A value as records have it: four decimals of a number."""
    return f"{value:.4f}" if isinstance(value, float) else "" if value is None else value


def read_records(path: Path) -> list[Row]:
    """Records of a CSV file; an empty field is None. Raises InputError for another file."""
    try:
        with path.open(newline="") as file:
            return [
                {k: row[k] if k in TEXTS else float(row[k]) if row[k] else None for k in FIELDS}
                for row in csv.DictReader(file)
            ]
    except (OSError, KeyError, ValueError, TypeError) as error:
        raise InputError(f"{path}: no records of research.painting ({error!r})") from None


class Cells:
    """Records by cell: the mean over seeds of any field of an arm."""

    def __init__(self, rows: Sequence[Row]) -> None:
        self._found: dict[Any, dict[Any, list[Row]]] = {}
        for row in rows:
            cell = self._found.setdefault((row["scene"], row["style"]), {})
            cell.setdefault((row["arm"], row["at"]), []).append(row)

    def __iter__(self) -> Iterator[Any]:
        return iter(self._found)

    def value(self, cell: Any, arm: str, field: str, at: float | None = None) -> float | None:
        """The field of an arm in a cell; None where it has none."""
        values = [row[field] for row in self._found[cell].get((arm, at), [])]
        values = [each for each in values if each is not None]
        return fmean(values) if values else None

    def values(self, arm: str, field: str, at: float | None = None) -> list[float]:
        """The field in every cell that has it."""
        found = (self.value(cell, arm, field, at) for cell in self)
        return [each for each in found if each is not None]

    def points(self, arm: str) -> list[float]:
        """Seconds at which a strategy was measured, in any cell."""
        keys = {key for cell in self._found.values() for key in cell}
        return sorted(at for name, at in keys if name == arm and at)


class Contrast(NamedTuple):
    """A difference of a field between two arms, which the claim says is above or below zero."""

    field: str
    arm: str
    against: str
    sign: Literal[1, -1]
    """1: the claim wants the arm's value to be the higher one; -1: the lower."""
    at: float | None = None
    margin: float = 0.0
    """How far on the wrong side a difference still agrees with the claim."""
    other: str = ""
    """The field of the arm that it is compared with, where it is another."""


class Effect(NamedTuple):
    """The mean over cells of the differences of a contrast, arm less the other arm."""

    mean: float
    interval: Interval | None
    cells: int
    agree: int
    """Cells whose difference is on the claim's side, or within the margin."""
    side: int
    """1: the interval is on the claim's side; -1: on the other; 0: neither, or too few cells."""


def effect(test: Contrast, cells: Cells) -> Effect | None:
    """The effect of a test; None where no cell has both arms."""
    found = []
    for cell in cells:
        own = cells.value(cell, test.arm, test.field, test.at)
        theirs = cells.value(cell, test.against, test.other or test.field, test.at)
        if own is not None and theirs is not None:
            found.append(own - theirs)
    if not found:
        return None
    span, side = mean_interval(found), 0
    if span is not None:
        low, high = sorted(test.sign * end + test.margin for end in span)
        side = int(low > 0) - int(high < 0)
    agree = sum(test.sign * each + test.margin > 0 for each in found)
    return Effect(fmean(found), span, len(found), agree, side)


@dataclass(frozen=True)
class Claim:
    """A claim and how it is judged: by tests, or by a function of its own."""

    text: str
    tests: tuple[Contrast, ...] = ()
    least: float = 0.0
    """Share of the cells that must be on the claim's side in every test."""
    painted: int = 0
    """Views that the iterative update must have painted by END: else the runs were too short."""
    special: Callable[[Cells], tuple[Verdict, str]] | None = None

    def judge(self, cells: Cells) -> tuple[Verdict, str]:
        """The verdict, and the numbers in words."""
        if self.special:
            return self.special(cells)
        effects = [effect(test, cells) for test in self.tests]
        numbers = "; ".join(_said(*each) for each in zip(self.tests, effects))
        known = [each for each in effects if each is not None and each.interval is not None]
        painted = cells.values("iterative", "edits", END) if self.painted else []
        if len(known) < len(effects) or min(painted, default=0) < self.painted:
            return "not judged", numbers
        sides = [each.side for each in known]
        if min(sides) == 1 and all(each.agree >= self.least * each.cells for each in known):
            return "seen", numbers
        if max(sides) == 1:
            return "in part", numbers
        return ("opposite seen" if min(sides) == -1 else "not seen"), numbers


def _said(test: Contrast, found: Effect | None) -> str:
    against = "only blurred" if test.other else test.against
    what = f"{test.field}, {test.arm} less {against}" + (f" at {test.at:g} s" if test.at else "")
    what = what.replace("target_", "painted views' ")
    if found is None:
        return f"{what}: none"
    digits = 2 if abs(found.mean) >= 0.1 else 3
    ends = " to ".join(f"{end:+.{digits}f}" for end in found.interval or ())
    span = f" ({ends}{f'; tolerance {test.margin:g}' if test.margin else ''})" if ends else ""
    return f"{what}: {found.mean:+.{digits}f}{span}, {found.agree} of {found.cells} cells"


def factors(cells: Cells, paper: bool) -> list[tuple[float, bool]]:
    """In each cell, the cost by which the iterative update reaches what the single pass has first
    reached, over that one's; and whether it does, or the factor is only a least one."""
    found = []

    def price(cell: Any, arm: str, at: float) -> float:
        of = {k: cells.value(cell, arm, k, at) or 0.0 for k in ("seconds", "edits", "steps")}
        return EDIT_PRICE * of["edits"] + STEP_PRICE * of["steps"] if paper else of["seconds"]

    for cell in cells:
        curve = [(at, cells.value(cell, "iterative", "perceptual", at))
                 for at in cells.points("iterative")]  # fmt: skip
        curve = [(at, value) for at, value in curve if value is not None]
        for first in cells.points("single")[:1]:
            goal = cells.value(cell, "single", "perceptual", first)
            if goal is not None and curve:
                reached = [at for at, value in curve if value <= goal]
                last = price(cell, "iterative", reached[0] if reached else curve[-1][0])
                found.append((last / price(cell, "single", first), bool(reached)))
    return found


def judge_tenfold(cells: Cells) -> tuple[Verdict, str]:
    """Whether the single pass is ten times as fast, at the paper's prices and at ours."""
    words, verdicts = [], set[Verdict]()
    for name, paper in (("at the paper's prices", True), ("in processor seconds", False)):
        found = factors(cells, paper)
        if not found:
            return "not judged", "none"
        mean, reached = geometric_mean([each for each, _ in found]), sum(r for _, r in found)
        every = reached == len(found)
        words.append(f"{'' if every else 'at least '}{mean:.1f} times {name} (reached in "
                     f"{reached} of {len(found)} cells)")  # fmt: skip
        verdicts.add("seen" if mean >= TENFOLD else "not reached" if every else "not judged")
    return verdicts.pop() if len(verdicts) == 1 else "not judged", "; ".join(words)


def judge_style(cells: Cells) -> tuple[Verdict, str]:
    """Whether a scene is painted well enough in the paper's time."""
    spent = zip(cells.values("base", "seconds"), cells.values("base", "prepared"))
    seconds = [sum(each) for each in spent]
    words, done = [], [max(seconds, default=0) <= MOST_SECONDS]
    good = [True] * len(seconds)
    for field, goal, sign in (("energy", LEAST_ENERGY, 1), ("perceptual", MOST_PERCEPTUAL, -1)):
        values = cells.values("base", field)
        span = mean_interval(values)
        if span is None or not seconds:
            return "not judged", "too few cells"
        done.append(min(sign * (end - goal) for end in span) >= 0)
        there = sum(sign * (value - goal) >= 0 for value in values)
        good = [g and sign * (v - goal) >= 0 for g, v in zip(good, values)]
        words.append(f"{field} {fmean(values):.2f} ({span[0]:.2f} to {span[1]:.2f}), "
                     f"{there} of {len(values)} cells")  # fmt: skip
    words = [f"done in {min(seconds):.1f} to {max(seconds):.1f} s, good enough in {sum(good)} of "
             f"{len(good)} cells", *words]  # fmt: skip
    return ("seen" if all(done) else "not reached"), "; ".join(words)


END = 20.0
CLAIMS = (
    Claim("Averaging corresponding features makes the edited views agree", (
        Contrast("target_disagreement", "agree in 6", "base", -1),
        Contrast("target_disagreement", "agree in 6", "agree in 6", -1, None, 0.0, BLURRED),
    )),
    Claim("Averaging to the end blurs; ending it early (T_end) avoids that", (
        Contrast("target_energy", "agree in 6", "agree in 1", -1),
        Contrast("target_energy", "agree in 1", "base", 1, margin=0.1),
    )),
    Claim("A few views, edited together, suffice; planned ones better than random", (
        Contrast("perceptual", "base", "all", -1, margin=0.02),
        Contrast("perceptual", "base", "random", -1),
    )),
    Claim("The single pass is ahead of the iterative update", tuple(
        Contrast("perceptual", "single", "iterative", -1, at) for at in (5.0, 10.0)
    )),
    Claim("... 10 times faster", special=judge_tenfold),
    Claim("... with comparable quality in the end", (
        Contrast("perceptual", "single", "iterative", -1, END, 0.02),
        Contrast("energy", "single", "iterative", 1, END, 0.05),
    ), painted=108),  # 54 views of the garden, the most, twice
    Claim("Single pass, then iterative, is best", tuple(
        Contrast("perceptual", "combined", other, -1, END) for other in ("single", "iterative")
    )),
    Claim("MSE + Gram keeps the style where views contradict each other", tuple(
        Contrast(field, "base", "mse", -1) for field in ("perceptual", "gram")
    ), least=10 / 12),
    Claim("... by a random switch between the two losses", tuple(
        Contrast(field, "switch", "mse", -1) for field in ("perceptual", "gram")
    )),
    Claim("Likeness to the style (for CLIP's score) rises sooner in the single pass", tuple(
        Contrast("likeness", "single", "iterative", 1, at) for at in (5.0, 10.0)
    )),
    Claim("MSE + Gram is sharper and nearer in style than L1 + LPIPS", (
        Contrast("energy", "base", "l1+perceptual", 1),
        Contrast("gram", "base", "l1+perceptual", -1),
    )),
    Claim("A scene takes a style in 30 s", special=judge_style),
)  # fmt: skip
OWN = (
    Claim("One view leads", (
        Contrast("perceptual", "lead", "solve", -1), Contrast("energy", "lead", "solve", 1),
    )),
    Claim("One view leads, and Gram follows", (
        Contrast("perceptual", "base", "no lead", -1), Contrast("energy", "base", "no lead", 1),
    )),
    Claim("Pooled statistics", (
        Contrast("target_disagreement", "base", "statistics alone", -1),
        Contrast("perceptual", "base", "statistics alone", -1),
    )),
    Claim("Solved, not descended from the unedited scene", (
        Contrast("perceptual", "solve", "adam mse", -1), Contrast("energy", "solve", "adam mse", 1),
    )),
    Claim("The sum of the losses, not a random switch between them", (
        Contrast("perceptual", "base", "switch", -1), Contrast("gram", "base", "switch", -1),
    )),
)  # fmt: skip
ORDER = (
    "unedited", "solve", "lead", "no lead", "adam mse", "mse", "ratio 1", "ratio 3", "base",
    "switch", "l1+perceptual", "statistics alone", "agree in 1", "agree in 3", "agree in 6",
    "random", "all",
)  # fmt: skip
"""Arms in the order of the table of means."""


def report(rows: Sequence[Row]) -> str:
    """Claims with verdicts and numbers, gsedit's own parts, and the means of all arms."""
    cells = Cells(rows)
    lines = ["| claim | verdict | numbers |", "|---|---|---|"]
    for claim in (*CLAIMS, *OWN):
        found, words = claim.judge(cells)
        lines.append(f"| {claim.text} | **{found}** | {words} |")
    fields = ("energy", "perceptual", "gram", "likeness", "disagreement", "psnr", "seconds")
    lines += ["", f"| arm | cells | {' | '.join(fields)} |", "|---" * (len(fields) + 2) + "|"]
    strategies = [(n, at) for n in (*STRATEGIES, "repaint") for at in cells.points(n)]
    for name, at in [*((name, None) for name in ORDER), *strategies]:
        if count := len(cells.values(name, "energy", at)):
            means = [_mean(cells.values(name, field, at)) for field in fields]
            label = name if at is None else f"{name}, {at:g} s"
            lines.append(f"| {label} | {count} | {' | '.join(means)} |")
    return "\n".join(lines)


def _mean(values: Sequence[float]) -> str:
    return f"{fmean(values):.3f}" if values else ""


STRATEGIES = ("solved", "single", "iterative", "combined")
RACED = ("single", "iterative", "combined")
"""Strategies of the curves: their means are over the cells that have all of them."""
BLOCKS = {"base": 0, "agree in 1": 1, "agree in 3": 3, "agree in 6": 6}
FITS = ("solve", "mse", "ratio 1", "ratio 3", "base", "switch", "l1+perceptual", "adam mse")


def draw(rows: Sequence[Row], path: Path) -> None:
    """Write a PNG of four panels: T_end, the fits, and two curves over seconds."""
    from matplotlib.figure import Figure  # not pyplot: no global state, no window system

    cells = Cells(rows)
    figure = Figure(figsize=(11, 7), dpi=90, layout="constrained")
    panels = figure.subplots(2, 2).flatten()
    _draw_ends(panels[0], cells)
    _draw_fits(panels[1], cells)
    _draw_curves(panels[2], cells, "perceptual", "distance to the truth (figures 8, 10)")
    _draw_curves(panels[3], cells, "likeness", "likeness to the style (figure 9)")
    for panel in panels:
        panel.grid(which="major", color="#dddddd", linewidth=0.7)
        if panel.get_legend_handles_labels()[0]:
            panel.legend(fontsize=8)
    with atomic_path(path, overwrite=True) as temporary:
        figure.savefig(temporary, format="png")


def _draw_ends(panel: Any, cells: Cells) -> None:
    panel.set(title="agreement ends after so many blocks (figures 5, 6)")
    panel.set(xlabel="residual blocks", ylabel="over that of 0 blocks")
    lines = (
        ("target_energy", "target_energy", "energy of painted views"),
        ("target_disagreement", "target_disagreement", "disagreement of painted views"),
        (BLURRED, "target_disagreement", "the same, only blurred as much"),
    )
    for (field, base, label), (color, marker) in zip(lines, LOOKS):
        points = [(0, 1.0)]
        for arm, blocks in list(BLOCKS.items())[1:]:
            found = [(cells.value(c, arm, field), cells.value(c, "base", base)) for c in cells]
            shares = [own / of for own, of in found if own is not None and of]
            points += [(blocks, fmean(shares))] if shares else []
        panel.plot(*zip(*points), color=color, marker=marker, label=label)


def _draw_fits(panel: Any, cells: Cells) -> None:
    panel.set(title="fits and losses, less lead (figure 11)")
    panel.set(xlabel="energy", ylabel="perceptual distance")
    panel.plot(0, 0, "k+", label="lead")
    for name, (color, marker) in zip(FITS, LOOKS):
        x, y = (effect(Contrast(f, name, "lead", 1), cells) for f in ("energy", "perceptual"))
        if x is None or y is None:
            continue
        spans = [
            None if e.interval is None
            else [[e.mean - e.interval[0]], [e.interval[1] - e.mean]] for e in (x, y)
        ]  # fmt: skip
        label = "ratio 10" if name == "base" else name
        look = {"color": color, "marker": marker, "elinewidth": 0.5, "linestyle": ""}
        label = label.replace("ratio", "mse + gram,")
        panel.errorbar(x.mean, y.mean, spans[1], spans[0], label=label, **look)


def _draw_curves(panel: Any, cells: Cells, field: str, title: str) -> None:
    panel.set(title=title, xlabel="processor seconds", ylabel=field)
    at = cells.points("single")
    curves = {
        (c, name): [cells.value(c, name, field, seconds) for seconds in at]
        for c in cells
        for name in (*RACED, "solved", "repaint")
    }
    raced = [c for c in cells if all(None not in curves[c, name] for name in RACED)]
    for name, (color, marker) in zip((*RACED, "solved", "repaint"), LOOKS):
        lines = [curves[c, name] for c in raced if None not in curves[c, name]]
        if lines and len(lines) == len(raced):
            means = [fmean(filter(None, column)) for column in zip(*lines)]
            panel.plot(at, means, color=color, marker=marker, label=name)
    values = [(cells.value(c, "base", "seconds"), cells.value(c, "base", field)) for c in raced]
    values = [(x, y) for x, y in values if x is not None and y is not None]
    if values:
        x, y = map(fmean, zip(*values))
        panel.plot(x, y, "k*", markersize=10, label=f"gsedit's default ({len(values)} cells)")
