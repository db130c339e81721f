"""A rendering changes no setting of torch or NumPy, and none of them changes it."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from closeness import leaves, tensors, weights_like

from gsedit.bench.renderer.stability import EDGE_CASES
from rasterizer import Execution, render
from rasterizer.blending import cpp_backend

BY_NAME = {case.name: case for case in EDGE_CASES}


def flags() -> dict[str, object]:
    tiny = torch.tensor([1e-40]) * 0.5  # 0 where denormals are flushed
    return {
        "default dtype": torch.get_default_dtype(),
        "default device": torch.get_default_device(),
        "gradients": torch.is_grad_enabled(),
        "inference": torch.is_inference_mode_enabled(),
        "anomalies": torch.is_anomaly_enabled(),
        "threads": (torch.get_num_threads(), torch.get_num_interop_threads()),
        "denormals": bool(tiny > 0),
        "deterministic": (
            torch.are_deterministic_algorithms_enabled(),
            torch.is_deterministic_algorithms_warn_only_enabled(),
            torch.backends.cudnn.deterministic,
        ),
        "matmul": torch.get_float32_matmul_precision(),
        "mkldnn": torch.backends.mkldnn.enabled,
        "torch draws": torch.get_rng_state().tolist(),
        "numpy draws": [np.asarray(part).tolist() for part in np.random.get_state()],
        "numpy errors": np.geterr(),
    }


def differentiated(name: str = "ordinary crowd"):
    scene, view, background = BY_NAME[name].make(torch.float32)
    inputs = leaves(scene)
    picture = render(inputs, view, background=background, depth=True, median_depth=True)
    loss = (picture.color * weights_like(picture.color)).sum() + picture.depth.sum()
    return picture.color.detach(), torch.autograd.grad(loss, tensors(inputs))


@pytest.mark.parametrize("name", ["ordinary crowd", "empty scene", "nothing visible", "means nan"])
def test_no_global_flag_is_changed(name):
    before = flags()
    if BY_NAME[name].refused is None:
        differentiated(name)
    else:
        with pytest.raises(ValueError, match=r"means\[57, 2\]"):
            differentiated(name)
    assert flags() == before


def test_global_flags_of_others_change_nothing():
    picture, gradients = differentiated()
    torch.set_default_dtype(torch.float64)
    torch.use_deterministic_algorithms(True)
    try:
        again, others = differentiated()
    finally:
        torch.use_deterministic_algorithms(False)
        torch.set_default_dtype(torch.float32)
    assert again.dtype == torch.float32
    assert torch.equal(again, picture)
    assert all(torch.equal(a, b) for a, b in zip(others, gradients))


@pytest.mark.parametrize("compiled", [False, True])
def test_every_tensor_is_made_on_the_device_of_the_inputs(compiled):
    """Whatever is made on the default device, which has no values here, cannot be drawn."""
    if compiled and cpp_backend.load() is None:
        pytest.skip("no C++ compiler on this machine")
    scene, view, background = BY_NAME["ordinary crowd"].make(torch.float32)
    execution = Execution(kernel="compiled" if compiled else "torch")

    def drawn():
        inputs = leaves(scene)
        picture = render(inputs, view, background=background, depth=True, median_depth=True,
                         execution=execution)  # fmt: skip
        loss = picture.color.square().sum() + picture.depth.sum() + picture.median_depth.sum()
        return picture.color, *torch.autograd.grad(loss, tensors(inputs))

    wanted = drawn()
    with torch.device("meta"):
        found = drawn()
    assert all(torch.equal(a, b) for a, b in zip(found, wanted))
