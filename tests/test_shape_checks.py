"""Functions of the tree refuse what their annotations do not allow, under pytest."""

from __future__ import annotations

import pytest
import torch
from beartype import beartype
from jaxtyping import Float
from shape_checks import checked
from torch import Tensor

from gsedit.measures.losses import mse
from rasterizer import Gaussians


@checked(typechecker=beartype)
def product(a: Float[Tensor, "n m"], b: Float[Tensor, "m k"]) -> Float[Tensor, "n k"]:
    return (a @ b)[:, :4]


def sized(*size: int) -> Tensor:
    return torch.zeros(size)


@pytest.mark.parametrize(
    "call",
    [
        lambda: product(sized(2, 3), sized(2, 4)),
        lambda: product(sized(2, 3).long(), sized(3, 4)),
        lambda: product(sized(2, 3), sized(3, 5)),
        lambda: mse(sized(4, 4, 3), sized(4, 4, 3).int()),
        lambda: Gaussians(sized(2, 3), sized(3, 4), sized(2, 3), sized(2), sized(2, 1, 3)),
    ],
)
def test_what_does_not_fit_is_refused(call):
    assert product(sized(2, 3), sized(3, 4)).shape == (2, 4)
    with pytest.raises(TypeError):
        call()
