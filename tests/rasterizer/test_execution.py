"""Both backends under other modes of torch, with extreme settings and bad ones."""

import math
from contextvars import copy_context
from dataclasses import replace

import pytest
import torch
from closeness import leaves, tensors, weights_like
from scenes import cloud, gaussian

from rasterizer import Camera, Execution, Numerics, concatenate, render
from rasterizer.blending import cpp_backend as compiled
from rasterizer.numerics import AUTO, rule, ruling
from rasterizer.reference import render_reference

EXECUTIONS = [Execution(kernel="torch"), Execution(kernel="compiled")]


@pytest.fixture(params=EXECUTIONS, ids=["torch", "compiled"])
def execution(request):
    if request.param.kernel == "compiled" and compiled.load() is None:
        pytest.skip("no C++ compiler on this machine")
    return request.param


def gradients(scene, camera, execution, **options):
    inputs = leaves(scene)
    picture = render(inputs, camera, execution=execution, **options).color
    return torch.autograd.grad((picture * weights_like(picture)).sum(), tensors(inputs))


def test_second_derivatives_are_refused(execution):
    """They would lack the blending's part, without a sign of it."""
    scene, camera = cloud()
    inputs = leaves(scene)
    picture = render(inputs, camera, execution=execution).color
    with pytest.raises(RuntimeError, match="create_graph"):
        torch.autograd.grad(picture.square().sum(), inputs.means, create_graph=True)


def test_autocast_changes_no_bit(execution):
    """Networks beside it may run in bfloat16; its eight bits are too few for a picture."""
    scene, camera = cloud()
    inputs = leaves(scene.to(torch.float32))
    with torch.autocast("cpu", dtype=torch.bfloat16):
        picture = render(inputs, camera, execution=execution).color
    found = torch.autograd.grad((picture * weights_like(picture)).sum(), tensors(inputs))
    for a, b in zip(found, gradients(scene.to(torch.float32), camera, execution)):
        assert torch.equal(a, b)


def test_a_picture_may_be_changed_before_the_backward_pass(execution):
    """6 x 6 pixels are one tile: what is returned must not be what was kept."""
    scene, _ = cloud()
    camera = Camera(torch.eye(4, dtype=torch.float64), 6.0, 6.0, 3.0, 3.0, 6, 6)
    inputs = leaves(scene)
    drawn = render(inputs, camera, execution=replace(execution, tile_size=6))
    loss = (drawn.color * weights_like(drawn.color)).sum()
    with torch.no_grad():
        drawn.alpha.zero_()
    found = torch.autograd.grad(loss, tensors(inputs))
    for a, b in zip(found, gradients(scene, camera, replace(execution, tile_size=6))):
        assert torch.equal(a, b)


@pytest.mark.parametrize("near", [-100.0, -1e20, -math.inf])
def test_an_orthographic_camera_sees_behind_itself_in_order(near, execution):
    front, rear = gaussian((0.0, 0.0, -3.0), color=(0.0, 0.0, 1.0)), gaussian((0.0, 0.0, -2.0))
    camera = replace(cloud()[1], model="ortho")
    numerics = Numerics(near=near)
    scene = concatenate(rear, front)
    wanted = render_reference(scene, camera, numerics=numerics).color
    picture = render(scene, camera, numerics=numerics, execution=execution).color
    assert wanted.max() > 0.5
    assert (picture - wanted).abs().max() < 1e-4


def test_a_line_of_no_width_has_antialiased_gradients(execution):
    line = gaussian((0.0, 0.0, 2.0))
    thin = torch.tensor([[-math.inf, 6.0, -math.inf]], dtype=torch.float64)
    line = replace(line, log_scales=thin)
    numerics = Numerics(antialiased=True)
    for found in gradients(line.to(torch.float32), cloud()[1], execution, numerics=numerics):
        assert found.isfinite().all()


def test_an_execution_rules_what_is_rendered_without_one():
    def kernels():
        rule(Execution(kernel="torch"))
        rule(AUTO)
        return ruling(AUTO).kernel, ruling(Execution(kernel="compiled")).kernel

    assert copy_context().run(kernels) == ("torch", "compiled")
    assert ruling(AUTO) == AUTO
