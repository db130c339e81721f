"""Claims of the paper beside what was measured, each judged by one rule from all runs there are."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import exp, inf, log
from typing import Any

from gsedit.bench.results import markdown_table
from research.paper.arms import DEFAULT, ITERATIVE, PAPER, PERCEPTUAL, t_end_label
from research.paper.summary import Row
from research.paper.verdicts import Effects, Judgement, by_editor, judge, judge_factors

Summary = Mapping[str, Any]
MARGIN_DB = 1.0
"""An error that much larger is comparable: hardly seen where pictures are flicked through."""
LEAST_DB = 1.0
"""The size of a gain in dB where the paper gives none."""
LEAST_SHARPNESS = 0.2
"""The size of a difference of sharpness, in parts of the exact edit's gradient energy, or of its
logarithm."""
LEAST_EXCESS = 0.005
"""RMSE: least disagreement beyond that of unedited views that averaging could remove."""


@dataclass(frozen=True)
class Claim:
    """A sentence of the paper, and how its effect is measured."""

    text: str
    place: str
    effects: Callable[[Summary], Effects]
    half: float
    """Half of the claimed size, in units of the effects."""
    against: str
    """The size that half is taken of, in words."""
    shown: Callable[[float], str]
    """An effect in words."""
    is_factor: bool = False
    """Whether the effects are logarithms of factors, -inf of a run that does not get there."""

    def judge(self, summary: Summary, editor: str | None = None) -> Judgement | None:
        """Judge the effect with one editor, or with all; None where none was measured."""
        found = of_editor(self.effects(summary), editor)
        return judge_factors(found, self.half) if self.is_factor else judge(found, self.half)


def of_editor(effects: Effects, editor: str | None) -> Effects:
    """The effects with one editor; None: with all."""
    if editor is None:
        return effects
    return {s: {editor: each[editor]} for s, each in effects.items() if editor in each}


def _db(effect: float) -> str:
    return f"{effect:+.2f} dB"


def _share(effect: float) -> str:
    return f"{effect:+.0%}"


def _number(effect: float) -> str:
    return f"{effect:+.2f}"


def _factor(effect: float) -> str:
    return f"{exp(effect):.2g} times" if effect > -inf else "not"


def difference(one: str, other: str, metric: str, plus: float = 0.0) -> Callable[..., Effects]:
    """Effects: the metric of one arm less that of another on the same scene, editor and seed."""
    return pairs(one, other, lambda a, b: _less(a[metric], b[metric], plus))


def _less(a: float | None, b: float | None, plus: float) -> float | None:
    return None if a is None or b is None else a - b + plus


def pairs(
    one: str, other: str, effect: Callable[[Row, Row], float | None]
) -> Callable[[Summary], Effects]:
    """Effects of every two runs of these arms on the same scene, with the same editor and seed."""

    def found(summary: Summary) -> Effects:
        by_place = {
            (row["arm"], row["scene"], row["editor"], row["seed"]): row for row in summary["rows"]
        }
        triples = (
            (scene, editor, effect(row, by_place[other, scene, editor, seed]))
            for (arm, scene, editor, seed), row in by_place.items()
            if arm == one and (other, scene, editor, seed) in by_place
        )
        return gathered(triples)

    return found


def gathered(triples: Iterator[tuple[str, str, float | None]]) -> Effects:
    """Effects by scene and editor."""
    effects: dict[str, dict[str, list[float]]] = {}
    for scene, editor, value in triples:
        if value is not None:
            effects.setdefault(scene, {}).setdefault(editor, []).append(value)
    return effects


def _agreement(averaged: Row, alone: Row) -> float | None:
    """The part of the disagreement, beyond that of unedited views, that averaging removes."""
    before, after = alone["disagreement"], averaged["disagreement"]
    if before is None or after is None:
        return None
    return (before - after) / max(before - alone["unedited_disagreement"], LEAST_EXCESS)


def _nearer(one: Row, other: Row) -> float | None:
    """By how much the first is nearer to the sharpness of the reference."""
    return abs(log(other["sharpness"])) - abs(log(one["sharpness"]))


def log_factor(factor: float) -> float:
    """Logarithm of a speed-up; 0 is one that is not reached."""
    return log(factor) if factor else -inf


def _speed(arm: str, regime: str) -> Callable[[Summary], Effects]:
    def found(summary: Summary) -> Effects:
        return gathered(
            (race["scene"], race["editor"], log_factor(race[regime]))
            for race in summary["races"]
            if race["arm"] == arm
        )

    return found


TEN_TIMES = "10 times: 5"
ONE_DB = f"no size given; {LEAST_DB:g} dB: {LEAST_DB / 2:g}"
A_FIFTH = f"no size given; {LEAST_SHARPNESS:g} of the exact edit's gradient energy: 0.1"
NEARER = f"no size given; nearer to its gradient energy by a factor of e^{LEAST_SHARPNESS:g}: e^0.1"
NOT_WORSE = f"not more than {MARGIN_DB:g} dB below; effects are beyond that"
FASTER = "The single pass is 10 times faster than Instruct-NeRF2NeRF"


def _faster(arm: str, regime: str, note: str) -> Claim:
    text = f"{FASTER}: {note}"
    return Claim(text, "abstract, figures 7 to 9", _speed(arm, regime), log(5), TEN_TIMES, _factor,
                 is_factor=True)  # fmt: skip


CLAIMS: Sequence[Claim] = (
    _faster(PAPER, "real", "as printed, at the cost of InstructPix2Pix here"),
    _faster(PAPER, "measured", "as printed, as measured"),
    _faster(DEFAULT, "real", "gsedit's default, at the cost of InstructPix2Pix here"),
    Claim("... with comparable quality in the end", "abstract, section 5.1",
          difference(PAPER, ITERATIVE, "final_db", MARGIN_DB), 0.0, NOT_WORSE,
          lambda effect: _db(effect - MARGIN_DB)),
    Claim("Averaging corresponding latents makes the edited views agree",
          "section 4.1, figure 5 b and d", pairs(PAPER, f"{PAPER}: no consensus", _agreement), 0.5,
          "no size given; all disagreement beyond that of unedited views: half of it", _share),
    Claim("Averaging in all steps blurs; ending it after 10 of 50 avoids that",
          "figures 5 c and 6, section 4.2",
          difference(t_end_label(10), t_end_label(50), "target_sharpness"),
          LEAST_SHARPNESS / 2, A_FIFTH, _number),
    Claim("The style loss lessens the effect of views that contradict each other",
          "section 4.3, figure 11", difference(PAPER, f"{PAPER}: MSE", "final_db"), LEAST_DB / 2,
          ONE_DB, _db),
    Claim("... by a random switch between the two losses", "introduction",
          difference(f"{PAPER}: random switch", f"{PAPER}: MSE", "final_db"), LEAST_DB / 2, ONE_DB,
          _db),
    Claim("... and it is sharper than with the LPIPS loss of Instruct-NeRF2NeRF",
          "figure 11, section 5.2", pairs(PAPER, f"{PAPER}: {PERCEPTUAL}", _nearer),
          LEAST_SHARPNESS / 2, NEARER, _number),
)  # fmt: skip


def judgements(summary: Summary) -> list[tuple[Claim, Judgement | None]]:
    """Every claim with what the runs say; None where none was made."""
    return [(claim, claim.judge(summary)) for claim in CLAIMS]


def claims_table(summary: Summary) -> str:
    """Format the claims as a Markdown table."""
    rows = []
    for claim, found in judgements(summary):
        if found is None:
            rows.append((claim.text, claim.place, "", "", "", claim.against, "not measured"))
            continue
        rows.append((
            claim.text, claim.place, in_words(found, claim.shown), _by_editor(claim, summary),
            f"{found.scenes}, {found.runs}", claim.against, f"**{found.verdict}**",
        ))  # fmt: skip
    head = ("the paper", "where", "effect (95 %)", "by editor", "scenes, pairs",
            "its size: half of it", "here")  # fmt: skip
    return markdown_table(head, rows)


def in_words(found: Judgement, shown: Callable[[float], str]) -> str:
    """An effect with its interval."""
    if not found.has_interval:
        return f"{shown(found.effect)} (no interval)"
    return f"{shown(found.effect)} ({shown(found.low)} to {shown(found.high)})"


def _by_editor(claim: Claim, summary: Summary) -> str:
    """The effect and the verdict of each editor alone."""
    parts = []
    for editor, scenes in by_editor(claim.effects(summary)).items():
        if found := claim.judge(summary, editor):
            there = sum(value > -inf for values in scenes for value in values)
            got = f", {there} of {found.runs} got there" if claim.is_factor else ""
            parts.append(f"{editor}: {in_words(found, claim.shown)}{got}, {found.verdict}")
    return "; ".join(parts)
