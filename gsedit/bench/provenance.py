"""Provenance of a measurement: code, processor, threads and date."""

from __future__ import annotations

import os
import platform
import subprocess
from dataclasses import dataclass
from datetime import datetime, timezone
from functools import cache
from pathlib import Path

import torch

from gsedit.runs.environment import installed_version


@dataclass(frozen=True)
class Provenance:
    """Fields that every measurement has."""

    threads: int
    """Number of torch's threads."""
    commit: str
    machine: str
    date: str
    """Date and time, ISO 8601, UTC."""

    def __str__(self) -> str:
        return f"{self.date}, commit {self.commit}, {self.machine}, {self.threads} threads."


def provenance() -> Provenance:
    """Provenance of a measurement that is taken now."""
    date = datetime.now(timezone.utc).isoformat(timespec="seconds")
    return Provenance(torch.get_num_threads(), commit(), machine(), date)


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
