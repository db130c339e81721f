"""Verdicts of the claims by records, the table and the figure: nothing here runs an edit."""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import exp, log
from pathlib import Path
from typing import Literal, NamedTuple

from gsedit.errors import InputError
from gsedit.measures.interval import Interval, mean_interval
from gsedit.run.atomic import atomic_path
from research.figures import LOOKS

Row = Mapping[str, object]
TEXTS = ("scene", "style", "arm")
COUNTS = ("seed", "steps", "edits")
METERS = ("energy", "perceptual", "gram", "likeness", "disagreement", "psnr")
OF_TARGETS = ("target_energy", "target_disagreement", "blurred_disagreement")
FIELDS = (*TEXTS, "seed", "at", "seconds", "prepared", "steps", "edits", *METERS, *OF_TARGETS)
Verdict = Literal["seen", "in part", "not seen", "opposite seen", "not reached", "not judged"]

EDIT_PRICE, STEP_PRICE = 7.5, 0.15
"""Seconds of an edited view and of a step in the paper: 30 s for four views, 0.15 s a step."""
TENFOLD = 10.0
MOST_SECONDS, LEAST_ENERGY, MOST_PERCEPTUAL = 30.0, 0.5, 0.45
"""The quality that a painted scene is to reach, and in which time."""
SHARE_OF_CELLS = 10 / 12
"""Share of the cells in which MSE + Gram must be nearer than MSE."""


def number(value: object) -> object:
    """A value as records have it: four decimals of a number."""
    return f"{value:.4f}" if isinstance(value, float) else "" if value is None else value


def read_records(path: Path) -> list[dict[str, object]]:
    """Records of a CSV file; an empty field is None. Raises InputError for another file."""
    try:
        with path.open(newline="") as file:
            rows = list(csv.DictReader(file))
        return [{k: _value(k, row[k]) for k in FIELDS} for row in rows]
    except (OSError, KeyError, ValueError, TypeError) as error:
        raise InputError(f"{path}: no records of research.painting ({error!r})") from None


def _value(field: str, text: str) -> object:
    if field in TEXTS:
        return text
    if not text:
        return None
    return int(text) if field in COUNTS else float(text)


class Cells:
    """Records by cell: the mean over seeds of any field of an arm."""

    def __init__(self, rows: Sequence[Row]) -> None:
        self._found: dict[tuple[object, object], dict[tuple[object, object], list[Row]]] = {}
        for row in rows:
            cell = self._found.setdefault((row["scene"], row["style"]), {})
            cell.setdefault((row["arm"], row["at"]), []).append(row)

    def __iter__(self):
        return iter(self._found)

    def value(self, cell: object, arm: str, field: str, at: float | None = None) -> float | None:
        """The field of an arm in a cell; None where it has none."""
        rows = self._found[cell].get((arm, at), [])  # type: ignore[index]
        values = [row[field] for row in rows if row[field] is not None]
        return sum(map(float, values)) / len(values) if values else None  # type: ignore[arg-type]

    def values(self, arm: str, field: str, at: float | None = None) -> list[float]:
        """The field in every cell that has it."""
        found = (self.value(cell, arm, field, at) for cell in self)
        return [each for each in found if each is not None]

    def points(self, arm: str) -> list[float]:
        """Seconds at which a strategy was measured, in any cell."""
        return sorted(
            {at for each in self._found.values() for name, at in each if name == arm and at}
        )


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

    def differences(self, cells: Cells) -> list[float]:
        """Arm less the other arm, in every cell that has both."""
        found = []
        for cell in cells:
            own = cells.value(cell, self.arm, self.field, self.at)
            theirs = cells.value(cell, self.against, self.other or self.field, self.at)
            if own is not None and theirs is not None:
                found.append(own - theirs)
        return found


class Effect(NamedTuple):
    """The mean of differences over cells."""

    mean: float
    interval: Interval | None
    cells: int
    agree: int
    """Cells whose difference is on the claim's side, or within the margin."""
    side: Literal[1, 0, -1]
    """1: the interval is on the claim's side; -1: on the other; 0: neither, or too few cells."""


def effect(test: Contrast, cells: Cells) -> Effect | None:
    """The effect of a test; None where no cell has both arms."""
    found = test.differences(cells)
    if not found:
        return None
    towards = [test.sign * each + test.margin for each in found]
    interval, side = mean_interval(found), 0
    if interval is not None:
        low, high = sorted(test.sign * end + test.margin for end in interval)
        side = 1 if low > 0 else -1 if high < 0 else 0
    agree = sum(each > 0 for each in towards)
    return Effect(sum(found) / len(found), interval, len(found), agree, side)


def verdict(effects: Sequence[Effect | None]) -> Verdict:
    """The verdict of a claim by the effects of all its tests."""
    known = [each for each in effects if each is not None and each.interval is not None]
    if len(known) < len(effects) or not known:
        return "not judged"
    sides = [each.side for each in known]
    if min(sides) == 1:
        return "seen"
    if max(sides) == 1:
        return "in part"
    return "opposite seen" if min(sides) == -1 else "not seen"


@dataclass(frozen=True)
class Claim:
    """A claim and how it is judged: by tests, or by a function of its own."""

    text: str
    tests: tuple[Contrast, ...] = ()
    special: Callable[[Cells], tuple[Verdict, str]] | None = None

    def judge(self, cells: Cells) -> tuple[Verdict, str]:
        """The verdict, and the numbers in words."""
        if self.special:
            return self.special(cells)
        effects = [effect(test, cells) for test in self.tests]
        numbers = [_said(*each) for each in zip(self.tests, effects)]
        return verdict(effects), "; ".join(numbers)


def _said(test: Contrast, found: Effect | None) -> str:
    against = f"its {test.other}" if test.other else test.against
    what = f"{test.field}, {test.arm} less {against}" + (f" at {test.at:g} s" if test.at else "")
    if found is None:
        return f"{what}: none"
    digits = 2 if abs(found.mean) >= 0.1 else 3
    span = ""
    if found.interval:
        low, high = found.interval
        span = f" ({low:+.{digits}f} to {high:+.{digits}f})"
    return f"{what}: {found.mean:+.{digits}f}{span}, {found.agree} of {found.cells} cells"


def cost(row_edits: float, row_steps: float) -> float:
    """Seconds at the paper's prices."""
    return EDIT_PRICE * row_edits + STEP_PRICE * row_steps


def factors(cells: Cells, paper: bool) -> list[tuple[float, bool]]:
    """In each cell, the cost by which the iterative update reaches what the single pass has first
    reached, over that one's; and whether it does, or the factor is only a least one."""
    found = []
    points, own = cells.points("iterative"), cells.points("single")[:1]

    def price(cell: object, arm: str, at: float) -> float | None:
        if not paper:
            return cells.value(cell, arm, "seconds", at)
        edits, steps = (cells.value(cell, arm, field, at) for field in ("edits", "steps"))
        return None if edits is None or steps is None else cost(edits, steps)

    for cell in cells:
        for first in own:
            goal, base = (
                cells.value(cell, "single", "perceptual", first),
                price(cell, "single", first),
            )
            known = [(at, cells.value(cell, "iterative", "perceptual", at)) for at in points]
            known = [(at, value) for at, value in known if value is not None]
            if goal is None or base is None or not known:
                continue
            reached = [at for at, value in known if value <= goal]
            last = price(cell, "iterative", reached[0] if reached else known[-1][0])
            if last is not None:
                found.append((last / base, bool(reached)))
    return found


def judge_tenfold(cells: Cells) -> tuple[Verdict, str]:
    """Whether the single pass is ten times as fast, at the paper's prices and at ours."""
    words, verdicts = [], []
    for name, paper in (("at the paper's prices", True), ("in processor seconds", False)):
        found = factors(cells, paper)
        if not found:
            return "not judged", "none"
        mean = exp(sum(log(each) for each, _ in found) / len(found))
        reached = sum(each for _, each in found)
        least = "" if reached == len(found) else "at least "
        words.append(f"{least}{mean:.1f} times {name} (reached in {reached} of {len(found)} cells)")
        if mean >= TENFOLD:
            verdicts.append("seen")
        else:
            verdicts.append("not reached" if reached == len(found) else "not judged")
    return (verdicts[0] if len({*verdicts}) == 1 else "not judged"), "; ".join(words)


def judge_gram(cells: Cells) -> tuple[Verdict, str]:
    """Whether MSE + Gram is nearer than MSE by both meters, and in enough cells."""
    tests = tuple(Contrast(field, "base", "mse", -1) for field in ("perceptual", "gram"))
    effects = [effect(test, cells) for test in tests]
    found = verdict(effects)
    enough = all(each and each.agree >= SHARE_OF_CELLS * each.cells for each in effects)
    words = "; ".join(_said(*each) for each in zip(tests, effects))
    return ("in part" if found == "seen" and not enough else found), words


def judge_style(cells: Cells) -> tuple[Verdict, str]:
    """Whether a scene is painted well enough in the paper's time."""
    parts = []
    for field, goal, sign in (("energy", LEAST_ENERGY, 1), ("perceptual", MOST_PERCEPTUAL, -1)):
        values = cells.values("base", field)
        span = mean_interval(values)
        if span is None:
            return "not judged", "too few cells"
        reached = (span[0] >= goal) if sign == 1 else (span[1] <= goal)
        cells_there = sum(sign * (value - goal) >= 0 for value in values)
        mean = sum(values) / len(values)
        parts.append(
            (
                reached,
                f"{field} {mean:.2f} ({span[0]:.2f} to {span[1]:.2f}), "
                f"{cells_there} of {len(values)} cells",
            )
        )
    seconds = [
        own + (cells.value(cell, "base", "prepared") or 0)
        for cell in cells
        if (own := cells.value(cell, "base", "seconds")) is not None
    ]
    if not seconds:
        return "not judged", "no seconds"
    quick = max(seconds) <= MOST_SECONDS
    words = f"{min(seconds):.1f} to {max(seconds):.1f} s; " + "; ".join(text for _, text in parts)
    return ("seen" if quick and all(done for done, _ in parts) else "not reached"), words


END = 20.0
CLAIMS = (
    Claim("Averaging corresponding features makes the edited views agree", (
        Contrast("target_disagreement", "agree in 6", "base", -1),
        Contrast("target_disagreement", *("agree in 6",) * 2, -1, other="blurred_disagreement"),
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
    )),
    Claim("Single pass, then iterative, is best", tuple(
        Contrast("perceptual", "combined", other, -1, END) for other in ("single", "iterative")
    )),
    Claim("MSE + Gram keeps the style where views contradict each other", special=judge_gram),
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
    Claim("Planned views for random ones", (Contrast("perceptual", "base", "random", -1),)),
    Claim("Solved, not descended from the unedited scene", (
        Contrast("perceptual", "solve", "adam mse", -1), Contrast("energy", "solve", "adam mse", 1),
    )),
    Claim("The sum for the switch", (
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
    return f"{sum(values) / len(values):.3f}" if values else ""


STRATEGIES = ("solved", "single", "iterative", "combined")
BLOCKS = ("base", "agree in 1", "agree in 3", "agree in 6")
FITS = ("unedited", "solve", "lead", "mse", "ratio 1", "ratio 3", "base", "switch", "l1+perceptual")


def draw(rows: Sequence[Row], path: Path) -> None:
    """Write a PNG of four panels: T_end, the losses, and two curves over seconds."""
    from matplotlib.figure import Figure  # not pyplot: no global state, no window system

    cells = Cells(rows)
    figure = Figure(figsize=(11, 7), dpi=100, layout="constrained")
    (ends, losses), (near, like) = figure.subplots(2, 2)
    ends.set(title="agreement ends after so many blocks (figure 5)", xlabel="residual blocks")
    for (field, label), (color, marker) in zip(
        (("target_energy", "energy of painted views"),
         ("target_disagreement", "disagreement of painted views"),
         ("blurred_disagreement", "the same, only blurred as much")), LOOKS,
    ):  # fmt: skip
        points = [
            (int(arm.split()[-1]) if arm != "base" else 0, found)
            for arm in BLOCKS
            if (found := _relative(cells, arm, field)) is not None
        ]
        if points:
            ends.plot(*zip(*points), color=color, marker=marker, label=label)
    ends.set_ylabel("over that of 0 blocks")
    losses.set(title="fits, and losses (figure 11)", xlabel="energy", ylabel="perceptual distance")
    for name, (color, marker) in zip(FITS, LOOKS):
        across, up = cells.values(name, "energy"), cells.values(name, "perceptual")
        if across and up:
            x, y = sum(across) / len(across), sum(up) / len(up)
            errors = [[[m - s[0]], [s[1] - m]] if (s := mean_interval(v)) else None
                      for m, v in ((x, across), (y, up))]  # fmt: skip
            label = (
                "mse + gram, ratio 10" if name == "base" else name.replace("ratio", "+ gram, ratio")
            )
            losses.errorbar(x, y, errors[1], errors[0], color=color, marker=marker, label=label,
                            elinewidth=0.5)  # fmt: skip
    for panel, field, title in (
        (near, "perceptual", "perceptual distance (figures 8, 10)"),
        (like, "likeness", "likeness to the style (figure 9)"),
    ):
        panel.set(title=title, xlabel="processor seconds", ylabel=field)
        for name, (color, marker) in zip((*STRATEGIES, "repaint"), LOOKS):
            points = [(at, cells.values(name, field, at)) for at in cells.points(name)]
            if points:
                line = [(at, sum(values) / len(values)) for at, values in points]
                panel.plot(*zip(*line), color=color, marker=marker, label=name)
    for panel in (ends, losses, near, like):
        panel.grid(which="major", color="#dddddd", linewidth=0.7)
        if panel.get_legend_handles_labels()[0]:
            panel.legend(fontsize=8)
    with atomic_path(path, overwrite=True) as temporary:
        figure.savefig(temporary, format="png")


def _relative(cells: Cells, arm: str, field: str) -> float | None:
    """Mean over cells of a field over BASE's own; BASE's pictures, not blurred, are its control."""
    own_field = "target_disagreement" if field == "blurred_disagreement" else field
    pairs = [
        (cells.value(cell, arm, field if arm != "base" else own_field),
         cells.value(cell, "base", own_field))
        for cell in cells
    ]  # fmt: skip
    shares = [own / base for own, base in pairs if own is not None and base]
    return sum(shares) / len(shares) if shares else None
