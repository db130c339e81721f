"""Edits and fits on several ranks and on two machines, ended from outside, and resumed.

python -m research.measure_ranks -o out/ranks --write-docs

A table: seconds from the event until every process has ended, the line that the user reads, and
what `--resume` makes of it; `--only fit` measures a part. The two machines are network namespaces
of this one, joined by a virtual cable (Linux, root, `ip`); without them the two torchruns meet on
the loopback.
"""

from __future__ import annotations

import atexit
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import torch
import typer

import gsedit
from gsedit.bench.provenance import provenance
from gsedit.bench.results import markdown_table
from gsedit.datasets.cameras_json import write_cameras
from gsedit.datasets.dataset import Dataset, capture
from gsedit.errors import UsageError
from gsedit.runs.state import load_state
from gsedit.synthetic import demo_scene, ring_cameras, surface_gaussians
from research.command import Output, print_message, print_result, run
from research.fit.captures import write_dataset
from research.paper.tables import write_page

PAGE = Path(__file__).parents[2] / "docs" / "measurements" / "ranks.md"
EDIT = (
    "edit {scene} gold --region all --size 64 --views 2 --batches 2 --steps 2 --loss mse+gram "
    "--update-steps 60 --checkpoint-every 0.3 -f -o {out}"
)
FIT = "fit {photos} --steps 200 --batch 4 --checkpoint-every 0.3 -f -o {out}/scene.ply"
LONGEST = 180.0
"""Seconds after which a rank that has not ended is killed, and counted as one that never ends."""
SPACES, CABLE = ("gsedit-a", "gsedit-b"), ("gsedit-va", "gsedit-vb")
ADDRESSES = ("10.111.0.1", "10.111.0.2")
FIELDS = ("means", "quats", "log_scales", "logit_opacities", "sh")
Act = Callable[["Run"], None]


@dataclass
class Run:
    """A command on ranks: one torchrun a machine."""

    launchers: list[subprocess.Popen[bytes]]
    log: Path
    size: int

    def pids(self, parents: set[int] | None = None) -> dict[int, int]:
        """Process ids by rank, of those that live; of some torchruns alone."""
        parents = parents or {launcher.pid for launcher in self.launchers}
        found = {}
        for folder in Path("/proc").iterdir():
            with suppress(OSError, ValueError, IndexError, StopIteration):
                parent = int((folder / "stat").read_text().rpartition(")")[2].split()[1])
                words = (folder / "environ").read_bytes().split(b"\0")
                rank = next(int(w[5:]) for w in words if w.startswith(b"RANK="))
                if parent in parents:
                    found[rank] = int(folder.name)
        return found

    def signal(self, rank: int, number: int) -> None:
        """Send a signal to one rank."""
        os.kill(self.pids()[rank], number)

    def signal_machine(self, machine: int, number: int) -> None:
        """Send a signal to all processes of a machine, as Ctrl-C in its terminal does."""
        parent = self.launchers[machine].pid
        for rank in self.pids({parent}).values() if number == signal.SIGKILL else ():
            os.kill(rank, number)  # torchrun does not hand this one on
        os.killpg(parent, number)

    def kill(self) -> None:
        """End what still runs, where the measurement itself is interrupted."""
        for launcher in self.launchers:
            if launcher.poll() is None:
                os.killpg(launcher.pid, signal.SIGKILL)

    def seconds_to_end(self, ranks: dict[int, int]) -> float:
        """Wait for the ranks, or without them for torchrun; infinite where one had to be killed.

        A torchrun that is cut off waits for the other a minute and longer: it is killed then.
        """
        began = time.monotonic()
        pids = list(ranks.values()) or [each.pid for each in self.launchers]
        while any(map(_lives, pids)):
            for launcher in self.launchers:
                launcher.poll()
            if time.monotonic() - began > LONGEST:
                self.kill()
                for pid in filter(_lives, pids):
                    os.kill(pid, signal.SIGKILL)
                return float("inf")
            time.sleep(0.05)
        seconds = time.monotonic() - began
        time.sleep(5.0 if ranks else 0.0)
        self.kill()
        for launcher in self.launchers:
            launcher.wait()
        return seconds

    def said(self) -> list[str]:
        """Lines that gsedit printed, without those of torchrun."""
        lines = self.log.read_text(errors="replace").splitlines()
        return [line for line in lines if line.startswith("gsedit: ")]


def _lives(pid: int) -> bool:
    try:
        text = Path(f"/proc/{pid}/stat").read_text()
    except OSError:
        return False
    return text.rpartition(")")[2].split()[0] != "Z"


def start(command: str, ranks: Sequence[int], log: Path, more: str = "") -> Run:
    """Start a command with so many ranks on each machine; namespaces where there are two."""
    launchers = []
    with log.open("wb") as file:
        for machine, count in enumerate(ranks):
            prefix, own = [], "--standalone"
            environment = {**os.environ, "OMP_NUM_THREADS": "1"}
            if len(ranks) > 1:
                place = ADDRESSES[0] if has_spaces() else "127.0.0.1"
                own = f"--nnodes {len(ranks)} --rdzv-backend c10d --rdzv-endpoint {place}:29517"
                if has_spaces():
                    prefix = ["ip", "netns", "exec", SPACES[machine]]
                    own += f" --local-addr {ADDRESSES[machine]}"
                    environment["GLOO_SOCKET_IFNAME"] = CABLE[machine]
                own += f" --rdzv-conf is_host={int(machine == 0)}"
            torchrun = ["-m", "torch.distributed.run", *own.split(), f"--nproc-per-node={count}"]
            words = ["-m", "gsedit_cli", *command.split(), *more.split()]
            launchers.append(
                subprocess.Popen(
                    [*prefix, sys.executable, *torchrun, *words],
                    stdout=file, stderr=file, env=environment, start_new_session=True,
                )
            )  # fmt: skip
    run = Run(launchers, log, sum(ranks))
    atexit.register(run.kill)
    return run


def has_spaces() -> bool:
    """Whether the network namespaces are there."""
    return Path("/run/netns", SPACES[0]).exists()


@contextmanager
def two_machines() -> Iterator[None]:
    """Two network namespaces and a cable between them, removed at the exit; none without rights."""
    made = (
        *(f"netns add {space}" for space in SPACES),
        f"link add {CABLE[0]} type veth peer name {CABLE[1]}",
        *(f"link set {cable} netns {space}" for cable, space in zip(CABLE, SPACES)),
        *(f"-n {s} addr add {a}/24 dev {c}" for s, a, c in zip(SPACES, ADDRESSES, CABLE)),
        *(f"-n {s} link set {each} up" for s, c in zip(SPACES, CABLE) for each in ("lo", c)),
    )
    try:
        for words in made:
            if subprocess.run(["ip", *words.split()], check=False).returncode:
                break
        yield
    finally:
        for space in SPACES:
            subprocess.run(["ip", "netns", "delete", space], check=False, capture_output=True)


def cut_cable(_: Run) -> None:
    """Take the second machine off the network: nothing tells the first."""
    subprocess.run(f"ip -n {SPACES[1]} link set {CABLE[1]} down".split(), check=True)


def mend_cable() -> None:
    subprocess.run(f"ip -n {SPACES[1]} link set {CABLE[1]} up".split(), check=True)


ONE_MACHINE: dict[str, Act] = {
    "Ctrl-C in the terminal": lambda run: run.signal_machine(0, signal.SIGINT),
    "SIGINT on the last rank": lambda run: run.signal(run.size - 1, signal.SIGINT),
    "SIGINT on rank 0": lambda run: run.signal(0, signal.SIGINT),
    "kill -9 of the last rank": lambda run: run.signal(run.size - 1, signal.SIGKILL),
    "kill -9 of rank 0": lambda run: run.signal(0, signal.SIGKILL),
    "kill -9 of torchrun": lambda run: run.launchers[0].kill(),
}
TWO_MACHINES: dict[str, Act] = {
    "Ctrl-C on the second machine": lambda run: run.signal_machine(1, signal.SIGINT),
    "kill -9 of all on the second machine": lambda run: run.signal_machine(1, signal.SIGKILL),
    "kill -9 of all on the first machine": lambda run: run.signal_machine(0, signal.SIGKILL),
    "the cable cut": cut_cable,
}
CASES = (
    *(("edit", (n,), name, act) for n in (2, 4) for name, act in ONE_MACHINE.items()),
    *(("fit", (2,), name, ONE_MACHINE[name]) for name in list(ONE_MACHINE)[1:4:2]),
    *(("edit", (1, 1), name, act) for name, act in TWO_MACHINES.items()),
)


def measure(command: str, out: Path, ranks: Sequence[int], act: Act, whole: Path) -> list[str]:
    """End a run by `act` soon after its first checkpoint, and resume it: cells of a row."""
    shutil.rmtree(out, ignore_errors=True)
    run = start(command, ranks, out.with_suffix(".log"))
    while not (kept := list(out.glob("[!.]*.safetensors"))) and run.launchers[0].poll() is None:
        time.sleep(0.05)
    time.sleep(0.5)
    pids = run.pids()
    act(run)
    seconds = run.seconds_to_end(pids)
    if act is cut_cable:
        mend_cable()
    whole_checkpoint = "whole" if kept and kept[0].exists() and load_state(kept[0]).tensors else "-"
    parts = len(list(out.rglob(".gs-*")))
    resumed = start(command, ranks, out.with_suffix(".resumed.log"), "--resume")
    took = resumed.seconds_to_end({})
    codes = [each.returncode for each in resumed.launchers]
    ended = f"{took:.1f} s, {difference(out, whole):.0e}" if not any(codes) else f"codes {codes}"
    lines = (line.removeprefix("gsedit: ").partition("; continue with")[0] for line in run.said())
    said = " / ".join(dict.fromkeys(lines)).replace(f"{out}/", "")
    return [f"{seconds:.1f}", said or "(nothing)", f"{whole_checkpoint}, {parts}", ended]


def difference(ours: Path, theirs: Path) -> float:
    """The largest of any number of the scenes; infinite for another number of Gaussians."""
    a, b = (gsedit.load(folder / "scene.ply") for folder in (ours, theirs))
    if len(a.means) != len(b.means):
        return float("inf")
    return max(float((getattr(a, f) - getattr(b, f)).abs().max()) for f in FIELDS)


def make_inputs(out: Path) -> None:
    """Write the scene with its cameras, and photos of it with its Gaussians as sparse points."""
    scene = surface_gaussians(demo_scene(), 2000, torch.Generator().manual_seed(0))
    gsedit.save(scene, out / "scene.ply", overwrite=True)
    views = capture(scene, ring_cameras(demo_scene(), 16, 64), [f"{i:02d}" for i in range(16)])
    write_cameras(views, out / "cameras.json", overwrite=True)
    colors = (0.5 + 0.2821 * scene.sh[:, 0]).clamp(0, 1)
    write_dataset(Dataset(views, scene.means.double(), colors), out / "photos")


def main(
    out: Output,
    chosen: Annotated[str, typer.Option("--only", help="A part of the cases' names.")] = "",
    docs: Annotated[bool, typer.Option("--write-docs", help="Write the page.")] = False,
) -> None:
    """Measure all cases, or those whose name holds a text, and print the table."""
    if docs and chosen:
        raise UsageError("--write-docs writes the whole table: leave out --only")
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))
    out.mkdir(parents=True, exist_ok=True)
    make_inputs(out)
    head = ("", "ranks", "ended after, s", "said", "kept; parts", "resumed, difference")
    rows: list[list[str]] = []
    wholes: dict[tuple[str, tuple[int, ...]], Path] = {}
    asked = [case for case in CASES if chosen in f"{case[0]} {case[1]} {case[2]}"]
    with two_machines() if any(len(case[1]) > 1 for case in asked) else nullcontext():
        for number, (verb, ranks, name, act) in enumerate(CASES):
            if (verb, ranks, name, act) not in asked or (act is cut_cable and not has_spaces()):
                continue
            text = {"edit": EDIT, "fit": FIT}[verb]
            places = {"scene": out / "scene.ply", "photos": out / "photos"}
            shown = " + ".join(map(str, ranks))
            if (verb, ranks) not in wholes:
                whole = wholes[verb, ranks] = out / f"whole_{verb}_{'_'.join(map(str, ranks))}"
                took = start(
                    text.format(**places, out=whole), ranks, whole.with_suffix(".log")
                ).seconds_to_end({})
                rows.append([f"{verb}, nothing happens", shown, f"{took:.1f}", "", "", ""])
            folder = out / f"case_{number}"
            command = text.format(**places, out=folder)
            cells = measure(command, folder, ranks, act, wholes[verb, ranks])
            rows.append([f"{verb}, {name}", shown, *cells])
            print_message(" | ".join(rows[-1]))
    print_result(table := markdown_table(head, rows))
    if docs:
        found = {"ranks-conditions": str(provenance()), "ranks": table}
        write_page(PAGE, found)


if __name__ == "__main__":
    run(main)
