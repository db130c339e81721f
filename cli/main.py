"""Entry point of the `gsedit` program: its verbs, its help and its exit codes."""

from __future__ import annotations

import os
import signal
import sys
import traceback
import warnings
from contextvars import copy_context
from typing import Annotated, Any

import typer
from typer.core import TyperGroup
from typer.main import get_command

from .chain import THEN, OperationCommand
from .core.command import SET, LazyCommand, verb_name
from .core.console import print_json, print_message
from .core.exits import FAILED, OK, USAGE, Interrupted, explain, one_line
from .verbs.app import app as app_verb
from .verbs.bench import bench, bench_
from .verbs.capture import capture
from .verbs.edit import edit
from .verbs.fit import fit
from .verbs.list import list_
from .verbs.looking import diff, info, measure, mesh
from .verbs.make import make
from .verbs.mcp import mcp
from .verbs.metrics import metrics
from .verbs.moves import align, transform
from .verbs.operations import clean, convert, decimate, filter_, merge, recolor
from .verbs.render import render
from .verbs.select import select
from .verbs.view import view

SENTENCES = ("edit", "make")
"""Verbs that take a sentence, which a shell splits where it is not in quotes."""
CHANGING = f"Change a scene (chain verbs with the word {THEN})"
"""Heading of the verbs that can follow each other in one command."""
PANELS = {
    "Edit from a sentence or a picture": (app_verb, edit, make),
    "Make a scene from photos": (capture, fit),
    "Look and measure": (info, select, view, render, mesh, measure, diff, metrics),
    CHANGING: (convert, filter_, clean, decimate, merge, transform, align, recolor),
    "Help": (list_, mcp, bench_),
}
"""The verbs under their headings in `gsedit --help`."""
COMPLETION = "_GSEDIT_COMPLETE"
"""Variable by which a shell asks for completions (docs/howto/install.md)."""


class Verbs(TyperGroup):
    """Group of commands, each made when it is asked for."""

    def __init__(self, **attributes: Any) -> None:
        super().__init__(**attributes)
        for panel, bodies in PANELS.items():
            for body in bodies:
                command = OperationCommand(body) if panel == CHANGING else LazyCommand(body)
                if body is bench_:  # a group
                    command.make = lambda: get_command(bench)
                self.add_command(command)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the verbs, a line each, by panel."""
        for panel, bodies in PANELS.items():
            commands = [self.commands[verb_name(body)] for body in bodies]
            with formatter.section(panel):
                rows = [(str(each.name), each.help or "") for each in commands]
                formatter.write_dl(rows, col_max=12)

    def main(self, args: Any = None, *rest: Any, **options: Any) -> Any:
        arguments = sys.argv[1:] if args is None else list(args)
        try:
            # not standalone: typer would print its own boxes and tracebacks
            options["standalone_mode"] = False
            # in a context of its own: --json, the scene and --kernel are this command's
            code = copy_context().run(super().main, arguments, *rest, **options)
        except BrokenPipeError:  # the reader of stdout left, as `head` does
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            code = FAILED
        except Exception as error:
            code = self.end(error, arguments)
        sys.exit(code or OK)

    def invoke(self, ctx: Any) -> Any:
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt as interruption:  # before typer turns it into a bare exit code
            raise Interrupted(explain(interruption)[0]) from None

    def end(self, error: Exception, arguments: list[str]) -> int:
        """Print one line about an error, with --json its parts too; return the exit code."""
        if "--debug" in arguments:
            traceback.print_exception(error)
        if hasattr(error, "format_message"):  # typer could not parse the command line
            return self.end_usage_error(error)
        said, code = explain(error)
        print_message(f"gsedit: {said}")
        if "--json" in arguments:
            print_json("error", {"what": said.what, "move": said.move, "values": said.values})
        return code

    def end_usage_error(self, error: Any) -> int:
        """Print typer's message about the command line on one line; return the exit code."""
        if not error.format_message().strip() or type(error).__name__ == "NoArgsIsHelpError":
            error.show()
        else:
            verb = error.ctx.command_path if getattr(error, "ctx", None) else "gsedit"
            # pydantic, which typer checks values with, begins its messages with "Value error, "
            message = one_line(error.format_message()).replace("Value error, ", "")
            message = message.replace(SET, "--set ")
            if message.startswith("Got unexpected extra arg") and verb.split()[-1] in SENTENCES:
                named = message.lower().endswith((".png)", ".jpg)", ".ply)"))
                message += ": add -o before the file" if named else ": put the sentence in quotes"
            print_message(f"{verb}: {message} (see {verb} --help)")
        return USAGE


app = typer.Typer(
    cls=Verbs,
    add_completion=False,
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def show_version(requested: bool) -> None:
    if requested:
        from importlib.metadata import version

        typer.echo(f"gsedit {version('gsedit')}")
        raise typer.Exit


@app.callback()
def gsedit(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=show_version, is_eager=True, help="Show the version and exit."
        ),
    ] = False,
) -> None:
    """Edit captured 3D scenes (Gaussian splats) from a sentence, on a machine without a GPU.

    gsedit VERB --help explains a verb. Exit codes: 0 done, 1 failed, 2 wrong request, 3 unreadable
    input, 130 interrupted. Results go to stdout, messages to stderr.
    """


def _interrupt(number: int, _: Any) -> None:
    raise KeyboardInterrupt(number)


def main() -> None:
    """Run the program. SIGTERM ends the work as Ctrl-C does, with its checkpoint kept.

    Python's warnings, which libraries raise about hostile files and print with a line of their
    source, are not shown: messages tell what a user can act on.
    """
    if not sys.warnoptions:
        warnings.simplefilter("ignore")
    signal.signal(signal.SIGTERM, _interrupt)
    if COMPLETION in os.environ:
        from typer._completion_classes import completion_init

        completion_init()
    app()
