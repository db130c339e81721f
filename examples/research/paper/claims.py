"""Claims of the paper beside what was measured: reproduced, not reproduced, or differently."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from gsedit.bench.results import markdown_table
from research.paper.studies import COMBINED, ITERATIVE, LPIPS, SINGLE_PASS

Numbers = Mapping[str, Any]
Verdict = Literal["reproduced", "not reproduced", "differently"]
SAME_DB = 0.5
"""Two errors whose means are nearer than this count as equal."""


@dataclass(frozen=True)
class Claim:
    """A sentence of the paper, and what was found."""

    text: str
    place: str
    measured: str
    verdict: Verdict


def claims(summary: Numbers) -> list[Claim]:
    """Those of which there are numbers."""
    return [claim for find in _FINDERS for claim in find(summary)]


def claims_table(summary: Numbers) -> str:
    """Format the claims as a Markdown table."""
    rows = [(c.text, c.place, c.measured, c.verdict) for c in claims(summary)]
    return markdown_table(("the paper", "where", "measured", "here"), rows)


def _speed(summary: Numbers) -> Iterator[Claim]:
    """Check the claim of a tenfold speed-up."""
    for editor, numbers in summary["editors"].items():
        factors = {
            regime: numbers["speed_up"][regime].get(SINGLE_PASS, {}).get("median_scene")
            for regime in ("costly", "measured", "paper")
        }
        if factors["costly"] is None:
            continue
        verdict: Verdict = (
            "reproduced" if factors["costly"] >= 10
            else "differently" if factors["costly"] > 1 else "not reproduced"
        )  # fmt: skip
        measured = (
            f"{editor}: iterative's final error {_times(factors['costly'])} where an evaluation "
            f"costs what Stable Diffusion's costs here, {_times(factors['measured'])} as measured, "
            f"{_times(factors['paper'])} at the paper's costs (median scene)"
        )
        yield Claim("The single pass is 10 times faster than Instruct-NeRF2NeRF",
                    "abstract, figures 7 to 9", measured, verdict)  # fmt: skip


def _quality(summary: Numbers) -> Iterator[Claim]:
    """Check the claim of comparable quality."""
    for editor, arms in _arms(summary, "strategies"):
        gap = _gap(arms, SINGLE_PASS, ITERATIVE, "final_db")
        if gap is None:
            continue
        verdict: Verdict = "reproduced" if gap > -SAME_DB else "not reproduced"
        yield Claim(
            "... with comparable quality in the end", "abstract, section 5.1",
            f"{editor}: single pass {_db(arms, SINGLE_PASS)}, iterative {_db(arms, ITERATIVE)}",
            verdict if gap < 2 else "differently",
        )  # fmt: skip


def _consistency(summary: Numbers) -> Iterator[Claim]:
    """Averaging makes views agree."""
    base = "x_t-1, independent noise"
    for _, arms in _arms(summary, "t-end"):
        alone, ten, whole = (arms.get(f"{base}: {n}") for n in (0, 10, 50))
        ours = arms.get("x0, shared noise: 10")
        if not (alone and ten and whole and ours):
            continue
        before, after = (_mean(a, "disagreement") for a in (alone, ten))
        yield Claim(
            "Averaging corresponding latents makes the edited views agree",
            "section 4.1, figure 5 b and d",
            f"near views differ by {before:.3f} one by one, by {after:.3f} averaged in 10 of 50 "
            f"steps as printed, by {_mean(ours, 'disagreement'):.3f} with x0 and shared noise",
            "reproduced" if after < 0.8 * before else "not reproduced",
        )
        sharp = [_mean(a, "target_sharpness") for a in (alone, ten, whole)]
        yield Claim(
            "Averaging in all steps blurs; ending it after T_end = 10 of 50 avoids that",
            "figures 5 c and 6, section 4.2",
            f"gradient energy over the exact edit's: {sharp[0]:.2f} one by one, {sharp[1]:.2f} "
            f"after 10 steps, {sharp[2]:.2f} after 50; edited pictures to the exact edit "
            f"{_mean(ten, 'target_db'):.1f} dB after 10, {_mean(whole, 'target_db'):.1f} dB "
            "after 50",
            "reproduced" if sharp[2] < 0.9 * sharp[1]
            else "differently" if sharp[2] > 1.1 * sharp[1] else "not reproduced",
        )  # fmt: skip


def _style(summary: Numbers) -> Iterator[Claim]:
    """The Gram loss forgives contradictions."""
    for _, arms in _arms(summary, "loss"):
        mse, printed, ours, switch = (
            arms.get(label)
            for label in ("MSE", "MSE + 0.1 Gram (paper's weight)", "MSE + 30 Gram (default)",
                          "switch, 30 Gram")
        )  # fmt: skip
        if not (mse and printed and ours):
            continue
        gain = _mean(ours, "final_db") - _mean(mse, "final_db")
        sharper = _mean(ours, "sharpness") / _mean(mse, "sharpness")
        yield Claim(
            "The style loss minimises the effect of views that contradict each other",
            "section 4.3, figure 11",
            f"against MSE alone, 30 Gram: {gain:+.2f} dB to the exact edit, gradient energy "
            f"{sharper:.2f} times; the paper's weight of 0.1: "
            f"{_mean(printed, 'final_db') - _mean(mse, 'final_db'):+.2f} dB",
            "reproduced" if gain > 0.1 else "differently" if sharper > 1.02 else "not reproduced",
        )
        lpips = arms.get(LPIPS)
        if lpips:
            ahead = _mean(ours, "final_db") - _mean(lpips, "final_db")
            sharper = _mean(ours, "sharpness") / _mean(lpips, "sharpness")
            yield Claim(
                "... and gives sharper pictures than the LPIPS loss of Instruct-NeRF2NeRF",
                "figure 11, section 5.2",
                f"MSE + 30 Gram against L1 + a learned distance of that kind: {ahead:+.2f} dB to "
                f"the exact edit, gradient energy {sharper:.2f} times",
                "reproduced" if ahead > -0.1 and sharper > 1.02
                else "differently" if ahead > 0.1 else "not reproduced",
            )  # fmt: skip
        if switch:
            lost = _mean(switch, "final_db") - _mean(ours, "final_db")
            yield Claim(
                "... by a random switch between the two losses", "introduction",
                f"the switch against the sum: {lost:+.2f} dB",
                "reproduced" if lost > -0.1 else "not reproduced",
            )  # fmt: skip


def _combination(summary: Numbers) -> Iterator[Claim]:
    """800 further steps instead of 3000."""
    for editor, numbers in summary["editors"].items():
        c = numbers["combined"]
        if not c["pairs"]:
            continue
        size = summary["size"]
        further, scratch = c["further_steps"]["median"], c["steps_from_scratch"]["median"]
        reached = c["reached"] > c["pairs"] / 2
        measured = (
            f"{editor}: {c['reached']} of {c['pairs']} reach it within {size['further_steps']} "
            f"further steps (of {size['iterative_steps']} from scratch)"
        )
        if further is not None:
            measured += f", the median one after {further:.0f}, from scratch after {scratch:.0f}"
        yield Claim(
            f"After the single pass, {COMBINED} needs 800 further steps for what {ITERATIVE} does "
            "in 3000", "section 5.2, figure 10", measured,
            "reproduced" if reached else "not reproduced",
        )  # fmt: skip


_FINDERS: tuple[Callable[[Numbers], Iterator[Claim]], ...] = (
    _speed, _quality, _consistency, _style, _combination,
)  # fmt: skip


def _arms(summary: Numbers, study: str) -> Iterator[tuple[str, Numbers]]:
    """(editor, metrics of its arms), where something was measured."""
    for editor, arms in summary["studies"].get(study, {"editors": {}})["editors"].items():
        yield editor, {label: m for label, m in arms.items() if m["final_db"]["count"]}


def _mean(metrics: Numbers, name: str) -> float:
    value = metrics[name]["mean"]
    return float("nan") if value is None else value


def _gap(arms: Numbers, one: str, other: str, name: str) -> float | None:
    if one not in arms or other not in arms:
        return None
    return _mean(arms[one], name) - _mean(arms[other], name)


def _db(arms: Numbers, label: str) -> str:
    deviation = arms[label]["final_db"]["deviation"]
    return f"{_mean(arms[label], 'final_db'):.1f} ± {deviation or 0:.1f} dB"


def _times(factor: float | None) -> str:
    if factor is None:
        return "not measured"
    return "is not reached" if factor == 0 else f"{factor:.1f} times sooner"
