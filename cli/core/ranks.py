"""A command on several ranks: rank 0 speaks and writes, and names the rank that ended it."""

from __future__ import annotations

import os
import signal
import sys
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NoReturn

from gsedit.errors import GseditError, UsageError
from gsedit.run.ranks import LostRankError, join, launched

from .exits import Interrupted, explain

if TYPE_CHECKING:
    from gsedit.run.ranks import Ranks
    from gsedit.run.state import State

VERBS = ("edit", "fit")
"""Those that share out their work."""
INTERRUPTED, ASKED = WORDS = "interrupted", "asked to end"
"""Words for the others of a rank that Ctrl-C ended, and of one that SIGTERM ended: by torchrun,
because of another rank, or by `kill`."""


def is_first() -> bool:
    """Whether this process prints and writes: it is rank 0, or alone."""
    return launched() == 1 or os.environ["RANK"] == "0"


@lru_cache(maxsize=1)
def ranks() -> Ranks:
    """The ranks that torchrun started, met at the first call. Raises LostRankError."""
    return join()


def joined() -> bool:
    """Whether the ranks have met."""
    return bool(ranks.cache_info().currsize) and launched() > 1


def meet(verb: str | None) -> None:
    """Join the other ranks before a verb begins. Raises UsageError for one that works alone,
    LostRankError where the ranks do not meet."""
    if launched() > 1:
        if verb not in VERBS:
            raise UsageError(f"gsedit {verb} runs on one rank: start it without torchrun")
        ranks()


def broadcast_state(read: Callable[[], State | None]) -> State | None:
    """Return the state that rank 0 reads, on every rank. Raises what `read` raises."""
    state = read() if is_first() else None
    if launched() == 1:
        return state
    from gsedit.run.state import State

    sent = ranks().first(state and (dict(state.record), dict(state.tensors), state.source))
    return sent and State(*sent)


def drain(steps: Iterable[Any]) -> None:
    """Do the work of a rank that prints and writes nothing."""
    deque(steps, maxlen=0)


def leave() -> None:
    """Wait for the other ranks to be done. Raises LostRankError."""
    if joined():
        ranks().leave()
        ranks.cache_clear()


def cause(error: Exception) -> Exception:
    """The error with the rank that caused it, and word of this one's for the others.

    An error of this rank's own stays as it is, and so does Ctrl-C. Where a rank says nothing, it
    was killed.
    """
    if not joined():
        return error
    signal.signal(signal.SIGTERM, signal.SIG_IGN)  # torchrun asks a rank to end that is about to
    here, own = ranks(), not isinstance(error, (Interrupted, LostRankError))
    by_user = _is_by_user(error)
    word = INTERRUPTED if by_user else ASKED * isinstance(error, Interrupted)
    here.say_end(explain(error)[0] if own else word)
    said, is_gone = {}, here.is_cut_off
    try:
        said = {} if own or by_user else here.ends()
    except LostRankError as lost:
        is_gone = True
        error = type(error)(f"{lost}; {error}") if isinstance(error, Interrupted) else lost
    if is_gone and here.rank and os.environ.get("LOCAL_RANK") == "0":
        sys.stderr.write(f"gsedit: rank {here.rank} of {here.size}: {error}\n")  # for its machine
    word, what = _blame(said, here.size)
    is_asked = isinstance(error, Interrupted)
    if not what or (is_asked and word == ASKED):
        return error
    rest = f"; {error}" if is_asked else ""
    silent = {rank for rank, reason in said.items() if reason is None}
    if 0 in silent:  # it wrote the checkpoints, and the first of the others speaks for it
        rest = "; what rank 0 kept is in the folder of its output"
        if here.rank == min({here.rank, *said} - silent):
            sys.stderr.write(f"gsedit: {what}{rest}\n")
    return (Interrupted if word else GseditError)(f"{what}{rest}")


def _blame(said: Mapping[int, str | None], size: int) -> tuple[str, str]:
    """The ranks that ended the run, by what each says of its end: INTERRUPTED, ASKED or "" for a
    fault, and a sentence, "" where no rank says anything.

    A rank that says nothing may be busy: it is named where no other gave a reason. torchrun asks
    the others of one that ended.
    """
    real = [(rank, text) for rank, text in said.items() if text not in ("", None, *WORDS)]
    silent = [rank for rank, reason in said.items() if reason is None]
    stopped = {word: [rank for rank in said if said[rank] == word] for word in WORDS}
    if real:
        return "", "; ".join(f"rank {rank} of {size} failed: {text}" for rank, text in real)
    if found := stopped[INTERRUPTED]:
        return INTERRUPTED, f"rank {found[0]} of {size} was {INTERRUPTED}"
    if silent:
        return "", f"{_named(silent, size)}: killed, out of memory, or cut off"
    if found := stopped[ASKED]:
        who = f"rank {found[0]} of {size} was" if len(found) == 1 else "the ranks were"
        return ASKED, f"{who} {ASKED}"
    return "", ""


def _is_by_user(error: Exception) -> bool:
    """Whether Ctrl-C ended this rank: SIGTERM, whose number is in the interruption, may come from
    torchrun, because of another rank."""
    cause = error.__context__
    return isinstance(error, Interrupted) and not (cause and cause.args)


def _named(silent: list[int], size: int) -> str:
    if len(silent) == 1:
        return f"rank {silent[0]} of {size} ended without a word"
    return f"ranks {', '.join(map(str, silent))} of {size} ended without a word"


def end(code: int) -> NoReturn:
    """Exit. On several ranks at once: threads of the connection could abort an orderly exit."""
    if launched() > 1:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    sys.exit(code)
