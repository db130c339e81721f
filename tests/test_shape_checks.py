"""Functions of the tree refuse what their annotations do not allow, under pytest."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import pytest
import torch
from beartype import beartype
from jaxtyping import Float
from shape_checks import checked
from torch import Tensor

from gsedit.measures.losses import mse

typed = checked(typechecker=beartype)


@typed
def product(a: Float[Tensor, "n m"], b: Float[Tensor, "m k"], *, k: int) -> Float[Tensor, "n k"]:
    return (a @ b)[:, :k]


@typed
def blank(height: int, width: int) -> Float[Tensor, "{height} {width}"]:
    return torch.zeros(height, 3)


@typed
def rows(a: Float[Tensor, "n m"]) -> Iterator[Float[Tensor, " m"]]:
    yield from a


@typed
@dataclass(frozen=True)
class Pair:
    a: Float[Tensor, " n"]
    b: Float[Tensor, " n"]
    name: str = ""


def sized(*size: int) -> Tensor:
    return torch.zeros(size)


def test_what_fits_passes():
    assert product(sized(2, 3), sized(3, 4), k=4).shape == (2, 4)
    assert product(sized(5, 1), sized(1, 6), k=6).shape == (5, 6)  # axes of another call
    assert blank(2, 3).shape == (2, 3)
    assert len(list(rows(sized(2, 3)))) == 2
    assert Pair(sized(2), sized(2)).name == ""


@pytest.mark.parametrize(
    "call",
    [
        lambda: product(sized(2, 3, 1), sized(3, 4), k=4),
        lambda: product(sized(2, 3), sized(2, 4), k=4),
        lambda: product(sized(2, 3).long(), sized(3, 4), k=4),
        lambda: product(sized(2, 3), sized(3, 4), k=2),
        lambda: product(sized(2, 3), sized(3, 4), k=4.0),  # pyright: ignore[reportArgumentType]
        lambda: blank(2, 4),
        lambda: rows(sized(2)),
        lambda: Pair(sized(2), sized(3)),
        lambda: Pair(sized(2), sized(2), name=1),  # pyright: ignore[reportArgumentType]
        lambda: mse(sized(4, 4, 3), sized(4, 4, 3).int()),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_refused(call):
    with pytest.raises(TypeError):
        call()


def test_annotations_stay_as_they_are_written():
    assert isinstance(mse.__annotations__["image"], str)
