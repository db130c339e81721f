"""Text encoders that are put away when every text was read, and loaded again for another one."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any


class TextNetwork:
    """A text encoder, called as its network is. Its weights take memory only while it is used."""

    def __init__(self, load: Callable[[], Any]) -> None:
        self._load = load
        self._network: Any = load()  # at once: what is wrong with it is told before an edit begins

    @property
    def network(self) -> Any:
        """The network; loaded again where it was put away."""
        if self._network is None:
            self._network = self._load()
        return self._network

    @property
    def in_memory(self) -> bool:
        """Whether it is loaded now."""
        return self._network is not None

    def __call__(self, *inputs: Any, **options: Any) -> Any:
        """The output of the network."""
        return self.network(*inputs, **options)

    def put_away(self) -> None:
        """Drop the weights from memory."""
        self._network = None
