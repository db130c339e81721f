"""A sentence as it was understood, as chips: each word of it that can be another is a control.

A control is named by an action of `gsedit.app.tab.button`: its new value makes a new sentence.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from html import escape

from gsedit.app.reading import Knob, Reading, read, turned
from gsedit.app.tab import button
from gsedit.change.materials.material import MATERIALS
from gsedit.words.instruction import Change, Instruction, sentence_of
from gsedit.words.lexicon import names, styles

Reader = Callable[[str], Instruction]

SAYS = {"material": "turn {part} into {name}", "light": "make it {name}",
        "look": "in the style of {name}"}  # fmt: skip
"""Sentences of changes that have many names."""
PARTS = ("subject", "background", "scene")


def chips_of(
    reading: Reading, knobs: Sequence[Knob], read: Reader, *, selected: bool = False
) -> str:
    """HTML of the chips of a sentence that was read, a line a change, and of words left unread."""
    lines = []
    for i, change in enumerate(reading.instruction.changes):
        # a selection confines what is said of the whole scene
        now = "subject" if selected and change.target == "scene" else change.target
        whole = _part(_of(change, now), selected=selected)
        parts = {t: _part(_of(change, t), selected=selected) for t in _parts(reading, i, read)}
        line = [_select(f"target {i}", "what changes", parts, now) if parts else escape(whole)]
        line.append(_what(reading, i, whole, any((i, "color") == (k.index, k.kind) for k in knobs)))
        line += [_knob(n, knob) for n, knob in enumerate(knobs) if knob.index == i]
        lines.append(f'<div class="line">{" ".join(line)}</div>')
    note = '<span class="chip unread" role="note" aria-label="not read: {0}">not read: {0}</span>'
    lines += [note.format(escape(words)) for words in reading.instruction.unread]
    return "".join(lines)


def offers(reading: Reading, names: Iterable[str]) -> str:
    """HTML of buttons for what the refusal of a sentence offers, so far as that can be done."""
    why, text = reading.refusal, reading.text
    of = re.compile(re.escape(why.of or text), re.IGNORECASE)
    said = [(of.sub(each, text), each) for each in why.offers]
    styled = [(SAYS["look"].format(name=each), each) for each in why.offers if each in styles()]
    known = [each for each in said if each[0] != text and not read(each[0], names).refusal]
    found = dict(known or styled)
    shown = "".join(button(f"say {each}", escape(name)) for each, name in found.items())
    unread = reading.instruction.refusal == "unread"
    return f"<div>{shown}{button('accept', 'Run it so') if unread else ''}</div>"


def renamed(reading: Reading, index: int, name: str) -> str:
    """The sentence with another name of a material, a light or a style."""
    change, text = reading.instruction.changes[index], reading.text
    place = text.lower().find(change.name.lower())
    if place >= 0:
        return text[:place] + name + text[place + len(change.name) :]
    return SAYS[change.kind].format(part=change.part, name=name)


def aimed(reading: Reading, index: int, target: str) -> str | None:
    """The sentence with another part that changes; None where no sentence says it."""
    changes = list(reading.instruction.changes)
    changes[index] = _of(changes[index], target)
    return sentence_of(changes)


def said(reading: Reading, knobs: Sequence[Knob], action: str, value: str) -> str:
    """The sentence after a control ("knob 0") was given a value."""
    kind, number = action.split()
    if kind == "knob":
        knob = knobs[int(number)]
        return turned(reading.instruction, knob, float(value) if knob.kind == "amount" else value)
    if kind == "name":
        return renamed(reading, int(number), value)
    return aimed(reading, int(number), value) or reading.text


def _of(change: Change, target: str) -> Change:
    if change.target == target:
        return change
    return replace(change, target=next(t for t in PARTS if t == target), phrase="")


def _part(change: Change, *, selected: bool) -> str:
    return "the selection" if selected and change.target == "subject" else change.part


def _parts(reading: Reading, index: int, read: Reader) -> list[str]:
    """The parts that a sentence can say of a change; none where there is no choice."""
    changes, found = reading.instruction.changes, []
    for target in PARTS:
        text = aimed(reading, index, target)
        if text and read(text).changes[index : index + 1] == (_of(changes[index], target),):
            found.append(target)
    return found if len(found) > 1 and changes[index].target in found else []


def _what(reading: Reading, index: int, part: str, colored: bool) -> str:
    """Words or a list for the change, with its color unless that is `colored` beside it."""
    change = reading.instruction.changes[index]
    stuff = MATERIALS.get(change.name) if change.kind == "material" else None
    color = "" if colored else change.color or (stuff and stuff.color)
    shown = f'<i class="swatch" style="background:{escape(color)}"></i>' if color else ""
    alone = len(reading.instruction.changes) == 1 or change.name.lower() in reading.text.lower()
    known: Iterable[str] = ()
    if alone and change.kind in SAYS:
        known = styles() if change.kind == "look" else names(change.kind)
    if change.name in known:
        options = {name: name for name in sorted(known)}
        return shown + _select(f"name {index}", change.kind, options, change.name)
    told = str(change).removeprefix(change.part).removesuffix(f" ({change.color})").strip()
    return shown + f"<span>{escape(told or part)}</span>"


def _knob(number: int, knob: Knob) -> str:
    action, label = f"knob {number}", escape(knob.label)
    if knob.kind == "color":
        return (
            f'<input type="color" data-do="{action}" value="{escape(str(knob.value))}" '
            f'aria-label="{label}">'
        )
    if knob.kind == "finish":
        unsaid = {} if knob.value else {"": knob.label}
        options = unsaid | {each: each for each in knob.choices}
        return _select(action, knob.label, options, str(knob.value))
    return (
        f'<label class="amount">{label} <input type="range" data-do="{action}" step="0.01" '
        f'min="{knob.low:g}" max="{knob.high:g}" value="{float(knob.value):g}"></label>'
    )


def _select(action: str, label: str, options: dict[str, str], value: str) -> str:
    """A list to choose from, by values and their words."""
    each = "".join(
        f'<option value="{escape(k)}"{" selected" * (k == value)}>{escape(v)}</option>'
        for k, v in options.items()
    )
    return f'<select class="chip" data-do="{action}" aria-label="{escape(label)}">{each}</select>'
