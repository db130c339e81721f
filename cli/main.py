"""The `gsedit` program: its verbs, and one table from what went wrong to one line and a code."""

from __future__ import annotations

import os
import signal
import sys
import traceback
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from .bench import bench
from .bench import describe as bench_summary
from .command import LazyCommand, lazy_verb, paragraphs
from .console import print_message
from .doctor import doctor
from .edit import edit
from .editors import editors
from .exits import FAILED, OK, USAGE, Interrupted, explain
from .fit import fit
from .info import info
from .preview import preview
from .render import render


class Verbs(TyperGroup):
    """The group of commands: each is made when it is asked for, and ends as `explain` says."""

    def __init__(self, **attributes: Any) -> None:
        super().__init__(**attributes)
        for body in (fit, edit, render, preview, info, editors, doctor):
            self.add_command(lazy_verb(body))
        self.add_command(LazyCommand("bench", bench_summary.__doc__ or "", lambda: bench))

    def main(self, args: Any = None, *rest: Any, **options: Any) -> Any:
        words = sys.argv[1:] if args is None else list(args)
        try:
            # not standalone: typer would print its own boxes and tracebacks
            code = super().main(words, *rest, **{**options, "standalone_mode": False})
        except BrokenPipeError:  # the reader of stdout left, as `head` does
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            code = FAILED
        except Exception as error:
            code = self.end(error, debug="--debug" in words)
        sys.exit(code or OK)

    def invoke(self, ctx: Any) -> Any:
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt as interruption:  # before typer turns it into a bare exit code
            raise Interrupted(explain(interruption)[0]) from None

    def end(self, error: Exception, *, debug: bool) -> int:
        """Say what went wrong; the exit code."""
        if debug:
            traceback.print_exception(error)
        if hasattr(error, "format_message"):  # the command line itself was not understood
            return self.misunderstood(error)
        line, code = explain(error)
        print_message(f"gsedit: {line}")
        return code

    def misunderstood(self, error: Any) -> int:
        if not error.format_message().strip() or type(error).__name__ == "NoArgsIsHelpError":
            error.show()
        else:
            verb = error.ctx.command_path if getattr(error, "ctx", None) else "gsedit"
            print_message(f"{verb}: {one_line_text(error.format_message())} (see {verb} --help)")
        return USAGE


def one_line_text(text: str) -> str:
    return " ".join(text.split())


app = typer.Typer(
    cls=Verbs,
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def show_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        typer.echo(f"gsedit {version('gsedit')}")
        raise typer.Exit


def gsedit(
    version: Annotated[
        bool,
        typer.Option("--version", callback=show_version, is_eager=True, help="Show the version."),
    ] = False,
) -> None:
    """Edit captured 3D scenes (Gaussian splats) from a sentence, on a machine without a GPU.

    Messages go to stderr, results to stdout. Exit codes: 0 done, 1 failed, 2 the request was not
    understood, 3 an input could not be read, 130 interrupted.
    """


app.callback(help=paragraphs(gsedit))(gsedit)


def _stop(*_: Any) -> None:
    raise KeyboardInterrupt


def main() -> None:
    """The entry point: `kill` ends the work as Ctrl-C does, with its checkpoint kept."""
    signal.signal(signal.SIGTERM, _stop)
    app()
