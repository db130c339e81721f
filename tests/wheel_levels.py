"""The kernels of an installed wheel, at every level that this processor has.

    python tests/wheel_levels.py

Needs torch and the wheel, and no compiler. Each level draws a cloud, and measures and moves a
picture, as torch does, to rounding; a line a level. Not a test of pytest: `make wheel` runs it in
an environment of its own, and so does cibuildwheel.
"""

from __future__ import annotations

import os
import subprocess
import sys

CAPABILITIES = ("", "avx2", "default")
"""Values of ATEN_CPU_CAPABILITY, which can only take from what the processor has; empty: unset."""
FIELDS = ("means", "quats", "log_scales", "logit_opacities", "sh")
BAR = 2e-5
"""Largest difference from torch, in float32: that of the tests of the kernels."""


def main() -> int:
    """Start a process for each level; 1 if one of them fails."""
    failed = 0
    for capability in CAPABILITIES:
        environment = {**os.environ, "CXX": "/nowhere/c++"}
        if capability:
            environment["ATEN_CPU_CAPABILITY"] = capability
        words = [sys.executable, __file__, "--child"]
        failed |= subprocess.run(words, env=environment, check=False).returncode
    return int(failed != 0)


def child() -> None:
    """Compare the kernels that this process gets with torch. Raises AssertionError."""
    import torch

    from gsedit.capture.fitting import adam
    from gsedit.capture.fitting.photometric import photometric
    from rasterizer import Camera, Execution, Gaussians, compiled, render
    from rasterizer.blending import cpp_backend

    made = compiled.make(cpp_backend.SOURCE)
    assert made.compiler.startswith("of the wheel"), made

    torch.manual_seed(0)
    n = 400
    where = torch.rand(n, 3) * 2 - 1 + torch.tensor([0.0, 0.0, 4.0])
    scene = Gaussians(where, torch.randn(n, 4), torch.rand(n, 3) - 3.0, torch.randn(n),
                      torch.randn(n, 4, 3) * 0.3)  # fmt: skip
    view = Camera(torch.eye(4), 80.0, 80.0, 48.0, 32.0, 96, 64)
    pictures, slopes = [], []
    for kernel in ("torch", "compiled"):
        fields = (getattr(scene, name).clone().requires_grad_() for name in FIELDS)
        inputs = Gaussians(*fields)
        drawn = render(inputs, view, execution=Execution(kernel=kernel)).color
        loss = photometric(drawn, torch.full_like(drawn, 0.3), 0.2, compiled=kernel == "compiled")
        loss.backward()
        pictures.append(drawn.detach())
        slopes.append(inputs.means.grad)
    apart = float((pictures[0] - pictures[1]).abs().max())
    turned = float((slopes[0] - slopes[1]).norm() / slopes[0].norm())
    moved = [adam.Moving(where.clone(), torch.zeros_like(where), torch.zeros_like(where))
             for _ in range(2)]  # fmt: skip
    for each, by_kernel in zip(moved, (False, True)):
        adam.step(each, slopes[0], 0.01, 1.0, compiled=by_kernel)
    stepped = float((moved[0].value - moved[1].value).abs().max())
    sys.stdout.write(
        f"{made.compiler}: {apart:.1e} of the picture, {turned:.1e} of the gradient, "
        f"{stepped:.1e} of a step from torch\n"
    )
    assert max(apart, turned, stepped) < BAR


if __name__ == "__main__":
    child() if "--child" in sys.argv else sys.exit(main())
