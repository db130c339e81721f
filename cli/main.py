"""The `gsedit` program: its verbs, and how every one of them ends."""

from __future__ import annotations

import os
import signal
import sys
import traceback
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from .align import align
from .bench import describe as bench_summary
from .bench_fit import bench
from .capture import capture
from .check import check
from .clean import clean
from .command import LazyCommand, lazy_verb, paragraphs
from .console import print_message
from .convert import convert
from .crop import crop
from .decimate import decimate
from .diff import diff
from .doctor import doctor
from .edit import edit
from .editors import editors
from .exits import FAILED, OK, USAGE, Interrupted, explain, one_line
from .filter import filter_
from .fit import fit
from .info import info
from .lod import lod
from .looks import looks
from .make import make
from .merge import merge
from .metrics import metrics
from .operations import THEN, operation_verb
from .order import order
from .preview import preview
from .ranks import cause, end, leave, meet
from .recolor import recolor
from .recover import recover
from .reduce_sh import reduce_sh
from .remove_background import remove_background
from .render import render
from .repair import repair
from .select import select
from .style import style
from .transform import transform
from .view import view

EDIT = (edit, make, style, capture, fit, recover, metrics, editors, looks)
OPERATIONS = (
    convert,
    filter_,
    crop,
    clean,
    repair,
    transform,
    align,
    recolor,
    remove_background,
    merge,
    decimate,
    order,
    reduce_sh,
)
"""Verbs that change a scene, and can follow each other in one command."""
LOOK = (info, check, select, render, preview, view, diff)


def in_panel(command: LazyCommand, panel: str) -> LazyCommand:
    """The verb, listed under a heading of its own in `gsedit --help`."""
    command.rich_help_panel = panel
    return command


class Verbs(TyperGroup):
    """The group of commands: each is made when it is asked for, and ends as `explain` says."""

    def __init__(self, **attributes: Any) -> None:
        super().__init__(**attributes)
        for panel, bodies in (("Edit from a sentence", EDIT), ("Look", LOOK)):
            for body in bodies:
                self.add_command(in_panel(lazy_verb(body), panel))
        panel = f"Change a scene (one after another with the word {THEN})"
        for body in OPERATIONS:
            self.add_command(in_panel(operation_verb(body), panel))
        self.add_command(in_panel(lazy_verb(lod), "Change a scene (into several files)"))
        machine = (
            lazy_verb(doctor),
            LazyCommand("bench", bench_summary.__doc__ or "", lambda: bench),
        )
        for command in machine:
            self.add_command(in_panel(command, "This machine"))

    def main(self, args: Any = None, *rest: Any, **options: Any) -> Any:
        arguments = sys.argv[1:] if args is None else list(args)
        try:
            # not standalone: typer would print its own boxes and tracebacks
            code = super().main(arguments, *rest, **{**options, "standalone_mode": False})
        except BrokenPipeError:  # the reader of stdout left, as `head` does
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            code = FAILED
        except Exception as error:
            code = self.end(cause(error), debug="--debug" in arguments)
        end(code or OK)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        name, command, rest = super().resolve_command(ctx, args)
        meet(name)
        return name, command, rest

    def invoke(self, ctx: Any) -> Any:
        try:
            result = super().invoke(ctx)
            leave()
            return result
        except KeyboardInterrupt as interruption:  # before typer turns it into a bare exit code
            raise Interrupted(explain(interruption)[0]) from None

    def end(self, error: Exception, *, debug: bool) -> int:
        """Print one line about an error; the exit code."""
        if debug:
            traceback.print_exception(error)
        if hasattr(error, "format_message"):  # typer could not parse the command line
            return self.end_usage_error(error)
        line, code = explain(error)
        print_message(f"gsedit: {line}")
        return code

    def end_usage_error(self, error: Any) -> int:
        """Print typer's complaint about the command line on one line; the exit code."""
        if not error.format_message().strip() or type(error).__name__ == "NoArgsIsHelpError":
            error.show()
        else:
            verb = error.ctx.command_path if getattr(error, "ctx", None) else "gsedit"
            # pydantic, which typer checks values with, begins its messages with "Value error, "
            message = one_line(error.format_message()).replace("Value error, ", "")
            if getattr(error, "option_name", "") == "--compile":
                message += " The compiled kernel is the default; --kernel torch does without it"
            print_message(f"{verb}: {message} (see {verb} --help)")
        return USAGE


app = typer.Typer(
    cls=Verbs,
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def show_version(requested: bool) -> None:
    if requested:
        from importlib.metadata import version

        typer.echo(f"gsedit {version('gsedit')}")
        raise typer.Exit


def gsedit(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=show_version, is_eager=True, help="Show the version and exit."
        ),
    ] = False,
) -> None:
    """Edit captured 3D scenes (Gaussian splats) from a sentence, on a machine without a GPU.

    Messages go to stderr, results to stdout. Exit codes: 0 done, 1 failed, 2 wrong request (an
    option, an instruction), 3 unreadable input, 130 interrupted.
    """


app.callback(help=paragraphs(gsedit))(gsedit)


def _interrupt(*_: Any) -> None:
    raise KeyboardInterrupt


def main() -> None:
    """The entry point. SIGTERM ends the work as Ctrl-C does, with its checkpoint kept."""
    signal.signal(signal.SIGTERM, _interrupt)
    app()
