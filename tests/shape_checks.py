"""Checks of types and shapes at every call, as jaxtyping makes them, in less time.

The option --jaxtyping-packages decorates all functions of the tree with `jaxtyping.jaxtyped`, which
binds the arguments of a call and checks them twice: a third of all time that the tests took.
`checked` takes its place: it checks them once, and the result, with the same sizes of axes; and of
many calls in one test the first MOST. What is not called is not prepared for it either, and what
has no tensors is left to the checker of types.
"""

from __future__ import annotations

import dataclasses
import inspect
from collections import Counter
from collections.abc import Callable
from functools import wraps
from types import CodeType
from typing import Any, get_type_hints

from beartype import BeartypeConf, beartype
from jaxtyping import jaxtyped

CHECK = beartype(conf=BeartypeConf(violation_type=TypeError))
"""Raises what `jaxtyped` raises."""
CALL = jaxtyped("context")
"""Axes have one size each in a call, and others in calls within it."""
Check = Callable[[Any], Any]
MOST = 2
"""Calls of a function that are checked in one test: small ones are called 100,000 times."""
CALLS: Counter[int] = Counter()
"""Calls by the identity of the code; cleared before each test."""
HINTS: dict[int, tuple[CodeType, dict[str, Any] | None]] = {}
"""Types of annotations by the identity of the code, which is held."""


def checked(function: Any = None, *, typechecker: Check) -> Any:
    """Decorate a function, or the constructor of a dataclass, as `jaxtyped` does."""
    if function is None:
        return lambda decorated: checked(decorated, typechecker=typechecker)
    if inspect.isclass(function):
        own = inspect.isfunction(vars(function).get("__init__"))
        own = own and not getattr(function, "__no_type_check__", False)
        if own and dataclasses.is_dataclass(function):
            function.__init__ = checked(function.__init__, typechecker=typechecker)
        return function
    if not inspect.isfunction(function) or not function.__annotations__:
        return function
    return jaxtyped(function, typechecker=typechecker) if _is_special(function) else _some(function)


def _is_special(function: Callable[..., Any]) -> bool:
    """Whether axes are named by values of arguments ("{height}"), or it yields."""
    named = any("{" in str(each) for each in function.__annotations__.values())
    return named or inspect.isgeneratorfunction(function)


def _some(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function with its first calls in a test checked."""
    number, strict = id(function.__code__), None
    if number not in HINTS:  # now: a test may put another class in the place of a named one
        HINTS[number] = function.__code__, _hints(function)
    if "Tensor" not in str(HINTS[number][1] or "Tensor"):
        return function

    @wraps(function)
    def call(*args: Any, **kwargs: Any) -> Any:
        __tracebackhide__ = True
        nonlocal strict
        if CALLS[number] >= MOST:
            return function(*args, **kwargs)
        CALLS[number] += 1
        strict = strict or _strict(function)
        return strict(*args, **kwargs)

    call.__annotations__ = dict(function.__annotations__)
    return call


def _hints(function: Callable[..., Any]) -> dict[str, Any] | None:
    """The types of a function's annotations; None where a name is not known at run time."""
    try:
        return get_type_hints(function, include_extras=True)
    except (NameError, AttributeError, TypeError):
        return None


def _strict(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function with all calls checked."""
    hints = HINTS[id(function.__code__)][1] or _hints(function)
    if hints is None:
        return jaxtyped(function, typechecker=beartype)
    written = function.__annotations__
    function.__annotations__ = dict(hints)
    each = CHECK(function)
    function.__annotations__ = written

    def call(*args: Any, **kwargs: Any) -> Any:
        __tracebackhide__ = True
        with CALL:
            return each(*args, **kwargs)

    return call
