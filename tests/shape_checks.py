"""Checks of types and shapes at every call, as jaxtyping makes them, in less time.

The option --jaxtyping-packages decorates all functions of the tree with `jaxtyping.jaxtyped`, which
binds the arguments of a call and checks them twice: a third of all time that the tests took.
`checked` takes its place: it checks them once, and the result, with the same sizes of axes.
"""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Callable
from functools import wraps
from typing import Any, get_type_hints

from beartype import BeartypeConf, beartype
from jaxtyping import jaxtyped

CHECK = beartype(conf=BeartypeConf(violation_type=TypeError))
"""Raises what `jaxtyped` raises."""
CALL = jaxtyped("context")
"""Axes have one size each in a call, and others in calls within it."""
Check = Callable[[Any], Any]


def checked(function: Any = None, *, typechecker: Check) -> Any:
    """Decorate a function, or the constructor of a dataclass, as `jaxtyped` does."""
    if function is None:
        return lambda decorated: checked(decorated, typechecker=typechecker)
    if inspect.isclass(function):
        if _has_own_constructor(function):
            function.__init__ = checked(function.__init__, typechecker=typechecker)
        return function
    if not inspect.isfunction(function) or not function.__annotations__:
        return function
    if _needs_jaxtyped(function):
        return jaxtyped(function, typechecker=typechecker)
    written = dict(function.__annotations__)
    call = _in_a_call_of_its_own(CHECK(function))
    call.__annotations__ = function.__annotations__ = written  # beartype puts types for strings
    return call


def _has_own_constructor(cls: type) -> bool:
    return (
        dataclasses.is_dataclass(cls)
        and not getattr(cls, "__no_type_check__", False)
        and inspect.isfunction(vars(cls).get("__init__"))
    )


def _needs_jaxtyped(function: Callable[..., Any]) -> bool:
    """Whether axes are named by values of arguments ("{height}"), it yields, or a name in its
    annotations is not known at run time."""
    if any("{" in str(each) for each in function.__annotations__.values()):
        return True
    if inspect.isgeneratorfunction(function):
        return True
    try:
        get_type_hints(function)
    except (NameError, AttributeError, TypeError):
        return True
    return False


def _in_a_call_of_its_own(function: Callable[..., Any]) -> Callable[..., Any]:
    @wraps(function)
    def call(*args: Any, **kwargs: Any) -> Any:
        __tracebackhide__ = True
        with CALL:
            return function(*args, **kwargs)

    return call
