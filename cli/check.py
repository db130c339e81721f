"""`gsedit check`: what is wrong with a scene file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .console import print_message, print_result
from .file_options import FileOptions
from .options import Common, Scene

if TYPE_CHECKING:
    from gsedit.points.check import Found, Report

SHOWN = 5
"""Rows that a line names; --json has all."""


def check(
    scene: Scene,
    quick: Annotated[
        bool,
        typer.Option(
            "--quick",
            help="Only what single rows show: for files larger than memory.",
        ),
    ] = False,
    strict: Annotated[
        bool, typer.Option("--strict", help="Exit code 1 for any defect, not only invalid rows.")
    ] = False,
    *,
    files: FileOptions,
    common: Common,
) -> None:
    """Name every defect of a scene file, with its rows and the command that mends it.

    gsedit check scene.ply

    It also reads files that other commands refuse. Exit code 1 where rows are invalid (NaN, Inf, a
    rotation of length 0), 0 otherwise; floaters, needles and the like are no error. Every law and
    its threshold are in docs/cleaning.md.
    """
    common.apply()
    from gsedit.files.formats import open_scene
    from gsedit.points.check import check as look

    source = open_scene(scene, files.read())
    for note in source.notes:
        print_message(f"{scene}: {note}")
    report = look(source, quick=quick)
    record = {"file": scene, "format": source.format, **as_record(report)}
    print_result(record, as_text(scene, source.format, report, quick), as_json=common.json)
    if report.refused or (strict and report.found):
        raise typer.Exit(1)


def as_record(report: Report) -> dict[str, Any]:
    """For a program: every defect with all its rows."""
    return {
        "gaussians": report.gaussians,
        "refused": report.refused,
        "defects": [
            {
                "name": each.defect.name,
                "law": each.defect.sentence,
                "reason": each.defect.reason,
                "mend": each.defect.mend,
                "count": len(each.rows),
                "rows": each.rows.tolist(),
            }
            for each in report.found
        ],
    }


def as_text(path: Path, format: str, report: Report, quick: bool) -> str:
    """A line a defect, then what to do."""
    lines = [f"{path}: {format}, {report.gaussians:,} Gaussians, {report.defective:,} with defects"]
    lines += [line(each) for each in report.found]
    names = {each.defect.name for each in report.found}
    if report.refused:
        lines.append(
            f"{report.refused:,} rows are invalid and make other commands refuse the file: "
            f"gsedit repair {path} -o REPAIRED.ply"
        )
    if any(each.defect.mend.startswith("clean") for each in report.found):
        first = "after that, " if report.refused else ""
        lines.append(f"{first}gsedit clean {path} -o CLEAN.ply removes what is not of the scene")
    if not names:
        lines.append("no defect was found" + (" in single rows (--quick)" if quick else ""))
    return "\n".join(lines)


def line(found: Found) -> str:
    """The defect, how often, where, and its law."""
    rows = ", ".join(map(str, found.rows[:SHOWN].tolist()))
    more = ", ..." if len(found.rows) > SHOWN else ""
    count = f"{len(found.rows):,}"
    return (
        f"  {found.defect.name:<11}{count:>9}  {found.defect.sentence}; {found.defect.mend} "
        f"(rows {rows}{more})"
    )
