"""Verbs and options that earlier versions had, each with the command line that replaces it."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Iterable

RENAMED_VERBS: dict[str, tuple[str, ...]] = {
    "check": ("info", "--check"),
    "crop": ("filter",),
    "editors": ("list", "editors"),
    "lod": ("decimate",),
    "order": ("convert",),
    "preview": ("view",),
    "recover": ("convert",),
    "reduce-sh": ("convert",),
    "remove-background": ("filter",),
    "repair": ("clean", "--repair"),
    "settings": ("list", "settings"),
}
"""First words of the new command line, by old verb."""

RENAMED_OPTIONS: dict[str, dict[str, str]] = {
    "edit": {"--rounds": "--batches"},
    "order": {"--by": "--order"},
    "reduce-sh": {"--degree": "--sh-degree"},
}
"""New name of an option, by old verb and old name."""

SELECTING = ("filter", "crop", "select", "recolor", "transform", "remove-background")
"""Verbs that had an option for each kind of selection."""

EXPRESSIONS: dict[str, str] = {
    "--box": "box({})",
    "--oriented-box": "oriented_box({})",
    "--sphere": "sphere({})",
    "--ellipsoid": "ellipsoid({})",
    "--cylinder": "cylinder({})",
    "--half-space": "half_space({})",
    "--inside": "inside('{}')",
    "--min-opacity": "opacity >= {}",
    "--max-opacity": "opacity <= {}",
    "--min-size": "size >= {}",
    "--max-size": "size <= {}",
    "--min-anisotropy": "anisotropy >= {}",
    "--max-anisotropy": "anisotropy <= {}",
    "--near-color": "near({})",
    "--largest": "largest({})",
    "--smallest": "smallest({})",
    "--seen": "seen(pixels={})",
    "--cluster": "cluster({})",
    "--within": "middle({})",
}
"""Form of an expression, by the option of a selection that it replaces; {} is the value."""

MODIFIERS = ("--cluster-gap", "--grow", "--shrink", "--prompt", "--invert")
"""Options of a selection that change what others select; only --invert has no value."""


def new_command(args: list[str], then: str) -> str | None:
    """Return the command line that replaces one with old names; None if nothing in it is old."""
    pieces = split(args, then)
    renewed = [renew(piece) for piece in pieces]
    if renewed == pieces:
        return None
    return f" {then} ".join(
        " ".join(map(quoted, p)) for p in (["gsedit", *renewed[0]], *renewed[1:])
    )


def split(args: Iterable[str], at: str) -> list[list[str]]:
    """Split the arguments at a word."""
    pieces: list[list[str]] = [[]]
    for each in args:
        if each == at:
            pieces.append([])
        else:
            pieces[-1].append(each)
    return pieces


def quoted(word: str) -> str:
    """Quote a word for a shell, in double quotes where it holds single ones."""
    if "'" in word and not set(word) & set('"$`\\!'):
        return f'"{word}"'
    return shlex.quote(word)


def renew(piece: list[str]) -> list[str]:
    """Return one verb of a command with new names in place of old ones."""
    if not piece:
        return piece
    verb, *rest = piece
    if verb in SELECTING:
        rest = with_expression(verb, rest)
    names = RENAMED_OPTIONS.get(verb, {})
    rest = [names.get(each, each) for each in rest]
    if verb not in RENAMED_VERBS:
        return [verb, *rest]
    return [*RENAMED_VERBS[verb], *MISSING.get(verb, lambda words: words)(rest)]


def with_expression(verb: str, words: Iterable[str]) -> list[str]:
    """Return the words with one --where in place of the old options of a selection."""
    kept, found, where = [], {}, []
    rest = iter(words)
    for each in rest:
        flag, equals, value = each.partition("=")
        if flag == "--invert":
            found[flag] = ""
        elif is_old(verb, flag):
            found[flag] = value if equals else next(rest, "")
        elif flag in ("--where", "--region"):
            where.append((flag, value if equals else next(rest, "")))
        else:
            kept.append(each)
    if verb == "remove-background" and "--within" not in found:
        found.setdefault("--prompt", "")
    given = dict(where)
    if found.keys() & {"--grow", "--shrink", "--invert", "--prompt"} and "--region" in given:
        found["--region"] = given.pop("--region")
    if not found:
        return list(words)
    return [*kept, *(word for pair in given.items() if pair[0] != "--where" for word in pair),
            "--where", expression(found, given.get("--where"))]  # fmt: skip


def is_old(verb: str, flag: str) -> bool:
    """Return whether a verb had this option of a selection, with a value."""
    if verb == "remove-background":
        return flag in ("--within", "--grow")
    return (flag in EXPRESSIONS and flag != "--within") or flag in MODIFIERS


def expression(found: dict[str, str], where: str | None) -> str:
    """Return the expression that says the same as old options of a selection."""
    parts = [form_of(flag, value, found) for flag, value in found.items() if flag in EXPRESSIONS]
    if "--region" in found:
        parts.append(region_form(found["--region"], found.get("--prompt", "")))
    elif "--prompt" in found:
        parts.append(region_form("auto", found["--prompt"]))
    if where is not None:
        parts.append(f"({where})" if parts else where)
    text = " and ".join(parts) or "all()"
    for flag in ("--grow", "--shrink"):
        if flag in found:
            text = f"{flag.removeprefix('--')}({text}, {found[flag]})"
    return f"not ({text})" if "--invert" in found else text


def form_of(flag: str, value: str, found: dict[str, str]) -> str:
    """Return the expression of one old option."""
    if flag == "--box":
        corners = value.split(",")
        ends = ["-inf"] * 3 + ["inf"] * 3
        value = ",".join(end if each.strip() == "-" else each for each, end in zip(corners, ends))
    elif flag == "--near-color" and "@" in value:
        picture, _, place = value.partition("@")
        column, row, *difference = place.split(",")
        value = ", ".join([f"'{picture}@{column},{row}'", *difference])
    elif flag in ("--largest", "--smallest"):
        amount, _, rest = value.partition(",")
        value = f"'{amount}', {rest}" if amount.endswith("%") else f"{amount}, {rest}"
    elif flag == "--cluster":
        gap = [f"gap={found['--cluster-gap']}"] if "--cluster-gap" in found else []
        if "," in value:
            return f"cluster_at({', '.join([value, *gap])})"
        value = ", ".join([*([] if value == "largest" else [value]), *gap])
    return EXPRESSIONS[flag].format(value)


def region_form(region: str, prompt: str) -> str:
    """Return the expression of a region."""
    if region == "auto":
        return f"subject('{prompt}')" if prompt else "subject()"
    if region == "all":
        return "all()"
    shape, colon, values = region.partition(":")
    if colon and shape in ("box", "sphere"):
        return f"{shape}({values})"
    return f"flags('{region}')" if region.endswith(".npy") else f"drawn('{region}')"


def with_default(flag: str, value: str) -> Callable[[list[str]], list[str]]:
    """Return a function that adds an option where it is missing."""
    return lambda words: words if flag in words else [*words, flag, value]


def levels(words: list[str]) -> list[str]:
    """Return the arguments of decimate --levels from those of lod."""
    words = with_default("--levels", "4")(words)
    if "--share" in words:
        at = words.index("--share")
        share, words = words[at + 1], [*words[:at], *words[at + 2 :]]
    else:
        share = "50%"
    return [*words[:1], share, *words[1:]]


def window(words: list[str]) -> list[str]:
    """Return the arguments of view from those of preview, which opened a window without -o."""
    has_output = any(word in ("-o", "--output") for word in words)
    return words if has_output else [*words, "--window"]


MISSING: dict[str, Callable[[list[str]], list[str]]] = {
    "order": with_default("--order", "morton"),
    "reduce-sh": with_default("--sh-degree", "0"),
    "lod": levels,
    "preview": window,
}
"""Functions that add what an old verb did without an option, by old verb."""
