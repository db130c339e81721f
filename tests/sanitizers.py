"""The C++ files under AddressSanitizer, UndefinedBehaviorSanitizer and ThreadSanitizer.

    PYTHONPATH=tests python tests/sanitizers.py [RUNS]

Each sanitizer has processes of its own, with its runtime preloaded, and a cache of its own. The
libraries are made as gsedit makes them: CXX has the sanitizer's flags. At the end one call is wrong
on purpose: a sanitizer that does not see it proves nothing. Exit code 1 for any report, and for
none there. Not a test of pytest: it takes minutes.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from dataclasses import dataclass, replace
from math import inf
from pathlib import Path

RUNS = 1500
"""Random renders under ASan and UBSan; a tenth of them under TSan, where each is slower."""
TIMEOUT_S = 1800
REPORT = re.compile(r"ERROR: AddressSanitizer|runtime error:|WARNING: ThreadSanitizer")
COMMON = "exitcode=0:halt_on_error=0:allocator_may_return_null=1"


@dataclass(frozen=True)
class Sanitizer:
    """How one is compiled in, and started."""

    name: str
    flags: str
    runtime: str
    """Library that must be loaded first."""
    options: dict[str, str]
    threads: tuple[int, ...]
    share: float
    """Share of RUNS that this sanitizer makes."""


SANITIZERS = (
    Sanitizer(
        "ASan + UBSan",
        "-fsanitize=address,undefined,float-cast-overflow -fsanitize-recover=all",
        "libasan.so",
        {"ASAN_OPTIONS": f"{COMMON}:detect_leaks=0", "UBSAN_OPTIONS": "print_stacktrace=1"},
        (1, 3),
        1.0,
    ),
    Sanitizer(
        "TSan",
        "-fsanitize=thread",
        "libtsan.so",
        {"TSAN_OPTIONS": f"{COMMON}:ignore_noninstrumented_modules=1:report_bugs=1"},
        (4,),
        0.1,
    ),
)
RACE = """
#include <thread>
static long total;
extern "C" void use_team(void*) {}
extern "C" void work(long) {
  std::thread a([] { total++; }), b([] { total++; });
  a.join();
  b.join();
}
"""


def main(runs: int) -> int:
    """Run all sanitizers and print a line for each kind of call; 1 if anything was reported."""
    failed = False
    for sanitizer in SANITIZERS:
        runtime = _runtime(sanitizer.runtime)
        if runtime is None:
            sys.stdout.write(f"{sanitizer.name}: not run, g++ has no {sanitizer.runtime} here\n")
            continue
        with tempfile.TemporaryDirectory() as cache:
            for work in ("renders", "updates", "proof"):
                failed |= _report(sanitizer, work, int(runs * sanitizer.share), runtime, cache)
    return int(failed)


def _runtime(name: str) -> str | None:
    """The path of g++'s library of that name; None where it has none."""
    if shutil.which("g++") is None:
        return None
    asked = subprocess.run(["g++", f"-print-file-name={name}"], capture_output=True, text=True)
    path = asked.stdout.strip()
    return path if os.path.isabs(path) else None


def _report(sanitizer: Sanitizer, work: str, runs: int, runtime: str, cache: str) -> bool:
    """Run one kind of calls in a process; print what came of it, and return whether it failed."""
    environment = {
        **os.environ, **sanitizer.options,
        "CXX": f"g++ -g1 -fno-omit-frame-pointer {sanitizer.flags}",
        "LD_PRELOAD": runtime, "XDG_CACHE_HOME": cache, "OMP_NUM_THREADS": "1",
    }  # fmt: skip
    command = [sys.executable, __file__, "--child", sanitizer.name, work, str(runs)]
    done = subprocess.run(
        command, env=environment, capture_output=True, text=True, errors="replace",
        timeout=TIMEOUT_S, check=False,
    )  # fmt: skip
    reports = REPORT.findall(done.stderr)
    wanted = work == "proof"
    failed = done.returncode != 0 or bool(reports) != wanted
    counts = json.loads(done.stdout.splitlines()[-1]) if done.stdout.strip() else {}
    said = ", ".join(f"{number} {name}" for name, number in counts.items()) or "nothing"
    verdict = "FAILED" if failed else "seen" if wanted else "clean"
    sys.stdout.write(f"{sanitizer.name:13} {said}: {len(reports)} reports, {verdict}\n")
    if failed:
        sys.stdout.write(f"  exit code {done.returncode}\n{done.stderr[:6000]}\n")
    sys.stdout.flush()
    return failed


# ---- what a process under a sanitizer does -------------------------------------------------------


def child(name: str, work: str, runs: int) -> None:
    """Make the calls of one kind; print their counts as JSON."""
    import torch

    from rasterizer import compiled, compiler

    compiler.TIMEOUT_S = TIMEOUT_S  # with a sanitizer it takes longer, and at -O3 minutes
    compiler.FLAGS = tuple("-O1" if flag == "-O3" else flag for flag in compiler.FLAGS)
    sanitizer = next(each for each in SANITIZERS if each.name == name)
    if name == "TSan":  # it does not know how OpenMP's threads wait for each other
        compiled._team = lambda: None
    counts: Counter[str] = Counter()
    calls = {"renders": _renders, "updates": _updates}
    if work == "proof":
        (_wrong_shape if name != "TSan" else _race)()
        counts["wrong call on purpose"] += 1
    else:
        for threads in sanitizer.threads:
            torch.set_num_threads(threads)
            generator = torch.Generator().manual_seed(threads)
            calls[work](max(1, runs // len(sanitizer.threads)), generator, counts)
    sys.stdout.write(f"{json.dumps(counts)}\n")


def _renders(runs: int, generator, counts: Counter[str]) -> None:
    """Draw ordinary, extreme and random scenes, forward and backward."""
    import torch
    from scenes import EDGE_CASES

    from gsedit.bench.renderer.stability import EDGE_CASES as EXTREMES
    from rasterizer import Numerics

    for make in EDGE_CASES.values():
        for dtype in (torch.float32, torch.float64):
            scene, camera = make()
            _draw(scene.to(dtype), camera, Numerics(), counts, {})
    for case in EXTREMES:
        scene, camera, background = case.make(torch.float32)
        _draw(scene, camera, Numerics(), counts, {"background": background})
    for _ in range(runs):
        _draw(*_random_render(generator), counts=counts, more={})


def _random_render(generator):
    """A scene of up to 300 Gaussians with numbers of any size, a camera, and settings."""
    import torch

    from gsedit.bench.renderer.stability import camera as camera_of
    from rasterizer import Gaussians, Numerics

    def pick(*choices):
        return choices[int(torch.randint(len(choices), (), generator=generator))]

    def normal(*shape):
        return torch.randn(*shape, generator=generator)

    n = pick(0, 1, 2, 7, 40, 300)
    means = normal(n, 3) * 10.0 ** pick(-20, -3, 0, 0, 0, 3, 10, 20, 37)
    means[:, 2] += pick(0.0, 3.0, 1e5)
    log_scales = normal(n, 3) * pick(0.5, 3.0, 20.0, 40.0) + pick(-2.0, -30.0, 3.0)
    logits = normal(n) * pick(1.0, 5.0, 1e30)
    sh = normal(n, pick(1, 4, 9, 16, 25), 3) * 10.0 ** pick(0, 0, 3, 30)
    quats = normal(n, 4) * 10.0 ** pick(0, 0, -20, 15)
    scene = Gaussians(means, quats, log_scales, logits, sh)
    for field in (log_scales, logits):
        if n and pick(0, 0, 0, 1):
            field[pick(0, -1)] = pick(-inf, inf)
    view = camera_of(pick(1, 3, 17, 40, 100), pick(1, 5, 32, 64), pick(1e-3, 40.0, 1e4))
    if pick(0, 0, 1):
        view = replace(view, model="ortho")
    numerics = Numerics(
        antialiased=pick(False, True), near=pick(0.01, 0.0, 1e-30), blur=pick(0.3, 0.0),
        transmittance_min=pick(1e-5, 0.0), gradient_min=pick(0.0, 1e-3),
        radius_clip=pick(0.0, 0.0, 2.0),
    )  # fmt: skip
    return scene.to(pick(torch.float32, torch.float32, torch.float64)), view, numerics


def _draw(scene, camera, numerics, counts: Counter[str], more) -> None:
    """Render with gradients, whole and in a crop, with tiles of several sides."""
    import torch

    from rasterizer import Execution, render

    half = (camera.width // 2, camera.height // 2)
    for crop, side in ((None, None), ((*half, camera.width - half[0], camera.height - half[1]), 3)):
        leaves = scene.map(lambda field: field.detach().clone().requires_grad_())
        try:
            drawn = render(
                leaves, camera, numerics=numerics, depth=True, median_depth=True, crop=crop,
                execution=Execution(kernel="compiled", tile_size=side), **more,
            )  # fmt: skip
            torch.autograd.backward((drawn.color.sum() + drawn.alpha.sum() + drawn.depth.sum(),))
            counts["renders drawn"] += 1
        except (ValueError, RuntimeError) as error:
            if "kernel 'compiled'" in str(error):
                raise
            counts["renders refused by name"] += 1


def _updates(runs: int, generator, counts: Counter[str]) -> None:
    """Take Adam steps and compare pictures, of ordinary, small, empty and extreme numbers."""
    import torch

    from gsedit.capture.fitting.adam import Moving, step
    from gsedit.capture.fitting.photometric import photometric

    assert _is_compiled()
    for i in range(max(20, runs // 3)):
        dtype = (torch.float32, torch.float64)[i % 2]
        n = (0, 1, 5, 1000)[i // 2 % 4]
        shape = ((n,), (n, 3), (n, 16, 3))[i // 8 % 3]
        size = 10.0 ** (0, 30, -30)[i // 24 % 3]
        value, first, second, gradient = (
            size * torch.randn(shape, generator=generator).to(dtype) for _ in range(4)
        )
        moving = Moving(value, first, second.square())
        step(moving, gradient, 1e-3, 0.9, compiled=True)
        step(moving, None, 1e-3, 0.9, compiled=True)
        step(moving, gradient, 1e-3, 0.9, torch.rand(shape[1:], generator=generator), compiled=True)
        counts["Adam steps"] += 3
    for i in range(max(20, runs // 3)):
        dtype = (torch.float32, torch.float64)[i % 2]
        shape = ((6, 6), (7, 41), (64, 33), (1, 64, 64), (3, 12, 9))[i // 2 % 5]
        size = (1.0, 1e18, 1e-18)[i // 10 % 3]
        image, target = (
            (size * torch.rand(*shape, 3, generator=generator)).to(dtype) for _ in range(2)
        )
        photometric(image.requires_grad_(), target, 0.2, compiled=True).backward()
        counts["photometric losses"] += 1


def _is_compiled() -> bool:
    from gsedit.capture.fitting import adam, photometric

    return adam.load() is not None and photometric.load() is not None


def _wrong_shape() -> None:
    """Call a kernel with moments of fewer rows than the values have."""
    import torch

    from gsedit.capture.fitting import adam

    assert _is_compiled()
    wrong = adam.Moving(torch.zeros(100, 3), torch.zeros(1, 3), torch.zeros(1, 3))
    adam._run(wrong, torch.ones(100, 3), 1e-3, 0.9, None)


def _race() -> None:
    """Let two threads add to one number."""
    import ctypes

    from rasterizer import compiler

    with tempfile.TemporaryDirectory() as folder:
        source, library = Path(folder) / "race.cpp", Path(folder) / "race.so"
        source.write_text(RACE)
        compiler.compile_library(compiler.find_compiler(), source, library)
        ctypes.CDLL(str(library)).work(0)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--child"]:
        child(sys.argv[2], sys.argv[3], int(sys.argv[4]))
    else:
        sys.exit(main(int(sys.argv[1]) if sys.argv[1:] else RUNS))
