"""Tables of a benchmark, and the machine and code that they are of."""

from __future__ import annotations

import os
import platform
import subprocess
from collections.abc import Iterable, Sequence
from functools import cache
from pathlib import Path

import torch

from gsedit.run.environment import installed_version


@cache
def commit() -> str:
    """Hash of the code that runs, with a + where files differ from it; else the version."""
    here = Path(__file__)
    try:
        git = ("git", "-C", str(here.parent))
        # a checkout of something else may surround an installed package: ask for this very file
        subprocess.run(
            (*git, "ls-files", "--error-unmatch", here.name), capture_output=True, check=True
        )
        described = subprocess.run(
            (*git, "describe", "--always", "--dirty=+", "--exclude=*"),
            capture_output=True, check=True, text=True,
        )  # fmt: skip
        return described.stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return installed_version("gsedit") or "unknown"


@cache
def machine() -> str:
    """Processor, cores and torch, in words."""
    return f"{_processor()}, {os.cpu_count()} cores, torch {torch.__version__.split('+')[0]}"


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        lines = []
    models = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return models[0] if models else platform.processor() or platform.machine()


def markdown_table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A Markdown table, its first column aligned left, the others right."""
    lines = [head, ["---", *("---:" for _ in head[1:])], *rows]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in lines)
