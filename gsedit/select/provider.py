"""Protocol of mask providers, which find what a phrase names in pictures of `h w` pixels."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Protocol, runtime_checkable

from jaxtyping import Float
from torch import Tensor


@runtime_checkable
class MaskProvider(Protocol):
    """Finds what a phrase names in pictures, each on its own."""

    @property
    def name(self) -> str:
        """Name by which it is chosen."""
        ...

    def check(self, phrase: str) -> None:
        """Raise UsageError for a phrase that it cannot look for, before any picture is made."""
        ...

    def masks(
        self, pictures: Sequence[Float[Tensor, "_ _ 3"]], phrase: str
    ) -> Iterator[Float[Tensor, "_ _"]]:
        """Yield the probability of each pixel to show it, a map a picture, in their order and size.

        Pictures are in [0, 1]. A picture that does not show it has a map of zeros.
        """
        ...
