"""A cache of results about one scene, for functions that many edits of it call alike.

Functions that find out something of a scene, as the light that it was captured in, are marked with
`cached_per_scene`. Where a `SceneCache` of that scene is in use, they answer from it what they were
asked before: the same result, sooner. Anywhere else they compute.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Hashable, Iterator, Sequence
from concurrent.futures import Future
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import fields, is_dataclass
from functools import wraps
from inspect import signature
from threading import Lock
from typing import Any, Concatenate, ParamSpec, TypeVar

from torch import Tensor

from rasterizer.scene import Gaussians

EACH = 2
"""Results of each function that are kept, the latest: those of what one looks at, and of one
selection before."""
P = ParamSpec("P")
T = TypeVar("T")


class SceneCache:
    """Cache of results about one scene, whose values nobody changes in place."""

    def __init__(self, scene: Gaussians) -> None:
        """Begin with nothing for this scene."""
        self._scene, self._place = scene, _place_of(scene)  # memory that is held is no other's
        self._found: dict[str, dict[Hashable, Future[Any]]] = {}
        self._lock = Lock()

    @contextmanager
    def used(self) -> Iterator[None]:
        """Answer from here in this thread until the context ends."""
        token = _in_use.set(self)
        try:
            yield
        finally:
            _in_use.reset(token)

    def has(self, scene: Gaussians) -> bool:
        """Whether this is the scene, or other names of the same memory."""
        return _place_of(scene) == self._place

    def result(self, name: str, asked: Sequence[Any], compute: Callable[[], T]) -> T:
        """The result that a function has for these arguments; of two threads that ask at once, one
        computes. What it raises is not kept."""
        key = _fingerprint(asked)
        with self._lock:
            found = self._found.setdefault(name, {})
            known = found.pop(key, None)
            found[key] = promised = known or Future()
            while len(found) > EACH:
                found.pop(next(iter(found)))
        if known is None:
            try:
                promised.set_result(compute())
            except BaseException as error:
                promised.set_exception(error)
                with self._lock:
                    if found.get(key) is promised:
                        del found[key]
        return promised.result()


@contextmanager
def cached(scene: Gaussians) -> Iterator[None]:
    """Answer from the cache in use, if it is of that scene, or a new one until the context ends."""
    place = _in_use.get()
    with (place if place and place.has(scene) else SceneCache(scene)).used():
        yield


def cached_per_scene(
    function: Callable[Concatenate[Gaussians, P], T],
) -> Callable[Concatenate[Gaussians, P], T]:
    """Let a function of a scene, its first argument, answer from the `SceneCache` in use."""
    known = signature(function)

    @wraps(function)
    def called(scene: Gaussians, *arguments: P.args, **more: P.kwargs) -> T:
        place = _in_use.get()
        if place is None or not place.has(scene):
            return function(scene, *arguments, **more)
        bound = known.bind(scene, *arguments, **more)
        bound.apply_defaults()  # what is left out is asked for too
        asked = bound.args[1:], *bound.kwargs.items()
        name = f"{function.__module__}.{function.__qualname__}"
        return place.result(name, asked, lambda: function(scene, *arguments, **more))

    return called


_in_use: ContextVar[SceneCache | None] = ContextVar("scene cache", default=None)


def _place_of(scene: Gaussians) -> tuple[tuple[int, ...], ...]:
    every = (getattr(scene, field.name) for field in fields(scene))
    return tuple((each.data_ptr(), each._version, *each.shape) for each in every)


def _fingerprint(value: Any) -> Hashable:
    """A value by its content: equal for equal arguments, and no other."""
    if isinstance(value, Tensor):
        content = value.detach().numpy().tobytes()
        return value.shape, value.dtype, hashlib.sha256(content).digest()
    if is_dataclass(value):
        parts = [getattr(value, field.name) for field in fields(value)]
        return type(value), _fingerprint(parts)
    if isinstance(value, (list, tuple)):
        return tuple(_fingerprint(each) for each in value)
    return value
