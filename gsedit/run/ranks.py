"""The processes that torchrun started, as one: what each computes, and how all get all of it.

Every rank holds the whole state and takes the same decisions from the same random numbers; only
what is expensive is shared out. A rank computes its part of the rows and receives the others'
(`rows`), or the ranks' gradients are summed (`add_up`). Transport is torch.distributed with gloo.
With one rank nothing is sent, and torch.distributed is not imported; nor is torch with this file.
"""

from __future__ import annotations

import io
import os
import sys
import threading
import time
import zlib
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, cast

from gsedit.errors import GseditError

if TYPE_CHECKING:
    from torch import Tensor

TICK_SECONDS = 0.5
"""How often a rank looks whether another has ended."""
BEAT_TICKS = 6
"""Ticks between two signs of life."""
MISSED_MOST = 10
"""Signs of life that may be missing before a rank counts as gone, 30 s: a busy machine swaps."""
ENDED = "ended"
"""Key that is set when any rank ends early."""
STORE_LOST = "torchrun does not answer: it was killed, or its machine is cut off"
"""Why ranks cannot go on whose store is gone: torchrun holds it."""


class Pulse(threading.Thread):
    """Thread that leaves this rank's signs of life in the store, and looks for the others'.

    It counts its own ticks, not seconds: a program that was stopped and goes on loses nobody.
    """

    def __init__(self, store: Any, rank: int, size: int) -> None:
        super().__init__(daemon=True)
        self.lost = ""
        """Why the work cannot go on: a sentence; "" while it can."""
        self.is_store_lost = False
        """Whether the store does not answer: nothing can be asked of the others."""
        self._store, self._rank = store, rank
        self._beats: dict[int, bytes] = {other: b"" for other in range(size) if other != rank}
        self._missed = dict.fromkeys(self._beats, 0)
        self._done = threading.Event()
        self._ticks = self._seen = self._hung = 0
        self._looked = time.monotonic()

    def look(self) -> str:
        """Say why the work cannot go on, "" while it can; for who waits, to call again and again.

        A store that is cut off lets this thread hang in its last question.
        """
        if (now := time.monotonic()) - self._looked < 2 * TICK_SECONDS:
            return self.lost
        self._hung = self._hung + 1 if self._ticks == self._seen else 0
        self._looked, self._seen = now, self._ticks
        if self._hung > MISSED_MOST * BEAT_TICKS / 2 and not self.lost:
            self._lose_store()
        return self.lost

    def stop(self) -> None:
        """End the thread: the ranks part."""
        self._done.set()
        self.join(2 * TICK_SECONDS)

    def run(self) -> None:
        while not self.lost and not self._done.wait(TICK_SECONDS):
            try:
                if self._store.check([ENDED]):
                    self.lost = self.lost or "another rank ended"
                elif self._ticks % BEAT_TICKS == 0:
                    self._beat(self._ticks)
            except RuntimeError:
                if not self._done.is_set():
                    self._lose_store()
            self._ticks += 1

    def _lose_store(self) -> None:
        self.is_store_lost = True
        self.lost = STORE_LOST

    def _beat(self, tick: int) -> None:
        self._store.set(f"beat/{self._rank}", str(tick))
        for other, before in self._beats.items():
            key = f"beat/{other}"
            now = self._store.get(key) if self._store.check([key]) else b""
            self._missed[other] = 0 if now != before else self._missed[other] + 1
            self._beats[other] = now
            if self._missed[other] > MISSED_MOST:
                self.lost = f"rank {other} gave no sign of life for {self._seconds():g} s"

    def _seconds(self) -> float:
        return MISSED_MOST * BEAT_TICKS * TICK_SECONDS


TIMEOUT = timedelta(minutes=30)
"""How long a rank waits for another: more than the slowest network needs for a view."""
SLICE = timedelta(seconds=0.5)
"""Waits are cut into slices: between two of them Python sees Ctrl-C and SIGTERM."""
ANSWER_SECONDS = 2.0
"""How long the other ranks have at least to say why they end."""
LONGEST_ANSWER = 20.0
"""How long they have while more than one is silent: some may still be at work, and find out later.
torchrun kills what is left after 30 s."""
VARIABLES = ("RANK", "WORLD_SIZE", "MASTER_ADDR", "MASTER_PORT")
"""Variables that torchrun sets for every process that it starts."""
FILE_VARIABLE = "GSEDIT_RANKS_FILE"
"""Variable with the URL of the file that ranks meet by where gsedit starts them itself: no port is
open then. The ports of torchrun are open to every machine of the network."""

T = TypeVar("T")


class LostRankError(GseditError):
    """Another rank ended, or did not answer in time."""


@dataclass(frozen=True, eq=False)
class Ranks:
    """This process among those that work together. `Ranks()` works alone."""

    rank: int = 0
    """0 to size - 1."""
    size: int = 1
    local: int = 1
    """How many of the ranks are on this machine: they share its memory."""
    store: Any = None
    """Texts that ranks leave for each other; torchrun holds it, so it outlives them."""
    pulse: Pulse | None = None
    """Looks whether the others are there; None for one rank."""

    def share(self, count: int) -> slice:
        """This rank's part of `count` rows: parts are contiguous and differ by one row at most."""
        return _part(count, self.rank, self.size)

    def rows(self, function: Callable[..., Tensor], *inputs: Tensor) -> Tensor:
        """`function(*inputs)`, each rank computing its share of the rows.

        `function` maps rows to as many rows, each on its own; the result has the same shape and
        dtype on every rank. Raises LostRankError.
        """
        import torch

        count = len(inputs[0])
        if self.size == 1 or not count:
            return function(*inputs)
        mine = self.share(count)
        own = function(*(x[mine] for x in inputs)) if mine.stop > mine.start else None
        if count < self.size:  # some ranks have no row, and learn the shape from the first
            like: Any = self.first(None if own is None else own[:1])
            own = like[:0] if own is None else own
        assert own is not None
        padded = own.new_zeros(-(-count // self.size), *own.shape[1:])  # gloo wants equal shapes
        padded[: len(own)] = own
        parts = self._gathered(padded)
        lengths = [_part(count, rank, self.size) for rank in range(self.size)]
        return torch.cat([part[: each.stop - each.start] for part, each in zip(parts, lengths)])

    def add_up(self, tensors: Sequence[Tensor]) -> None:
        """Replace each tensor (of one dtype) by its sum over the ranks, in one message. In place.

        Raises LostRankError.
        """
        if self.size == 1:
            return
        import torch
        from torch import distributed

        flat = torch.cat([tensor.detach().reshape(-1) for tensor in tensors])
        self._wait(distributed.all_reduce(flat, async_op=True))
        parts = flat.split([tensor.numel() for tensor in tensors])
        with torch.no_grad():
            for tensor, part in zip(tensors, parts):
                tensor.copy_(part.reshape(tensor.shape))

    def first(self, value: T) -> T:
        """Rank 0's value, on every rank: tensors, numbers, texts, and containers of them.

        Raises LostRankError.
        """
        if self.size == 1:
            return value
        import torch
        from torch import distributed

        data = io.BytesIO()
        if not self.rank:
            torch.save(value, data)
        length = torch.tensor([data.tell()])
        self._wait(distributed.broadcast(length, 0, async_op=True))
        message = torch.zeros(int(length), dtype=torch.uint8)
        if not self.rank:
            message = torch.frombuffer(bytearray(data.getvalue()), dtype=torch.uint8)
        self._wait(distributed.broadcast(message, 0, async_op=True))
        return torch.load(io.BytesIO(message.numpy().tobytes()), weights_only=True)

    def once(self, work: Callable[[], T]) -> T:
        """Do this work on rank 0 alone; its result is that of every rank (see `first`)."""
        return cast(T, self.first(None if self.rank else work()))

    def check_same(self, what: str, values: Iterable[Any]) -> None:
        """Raise GseditError, naming a rank, unless these tensors, numbers and texts are the same
        on all ranks: what follows would be of no use."""
        if self.size == 1:
            return
        import torch

        code = 0
        for value in values:
            data: Any = repr(value).encode()
            if isinstance(value, torch.Tensor):
                data = value.detach().contiguous().numpy()
            code = zlib.crc32(data, code)
        codes = [int(each) for each in self._gathered(torch.tensor([code]))]
        for rank, other in enumerate(codes):
            if other != codes[0]:
                raise GseditError(
                    f"{what} of rank {rank} differs from that of rank 0: start all ranks with the "
                    "same files, options and versions"
                )

    def leave(self) -> None:
        """Wait for the others to be done, and end the connection. Raises LostRankError."""
        if self.size > 1:
            import torch
            from torch import distributed

            self._gathered(torch.zeros(1))
            if self.pulse is not None:
                self.pulse.stop()
            distributed.destroy_process_group()

    def say_end(self, reason: str) -> None:
        """Leave word of why this rank ends; "" where another caused it."""
        if self.is_cut_off:
            return
        with suppress(RuntimeError):  # the store is gone, with torchrun
            self.store.set(f"end/{self.rank}", reason)
            self.store.set(ENDED, "")

    @property
    def is_cut_off(self) -> bool:
        """Whether torchrun's store is gone, by which ranks tell each other: a question may hang."""
        return self.pulse is not None and self.pulse.is_store_lost

    def ends(self) -> dict[int, str | None]:
        """Why the other ranks end (see `say_end`); None of those that say nothing in time.

        Raises LostRankError where the store does not answer: nobody can be asked.
        """
        said: dict[int, str | None] = dict.fromkeys(set(range(self.size)) - {self.rank})
        began = time.monotonic()
        while silent := [rank for rank, reason in said.items() if reason is None]:
            if self.is_cut_off:
                raise LostRankError(STORE_LOST)
            if time.monotonic() - began > (ANSWER_SECONDS if len(silent) == 1 else LONGEST_ANSWER):
                break
            try:
                time.sleep(0.05)
                for rank in silent:
                    if self.store.check([f"end/{rank}"]):
                        said[rank] = self.store.get(f"end/{rank}").decode()
            except KeyboardInterrupt:  # the rank is about to end
                continue
            except RuntimeError as error:
                raise LostRankError(STORE_LOST) from error
        return said

    def _gathered(self, tensor: Tensor) -> list[Tensor]:
        """Every rank's tensor; all have the same shape and dtype."""
        import torch
        from torch import distributed

        parts = [torch.empty_like(tensor) for _ in range(self.size)]
        self._wait(distributed.all_gather(parts, tensor.contiguous(), async_op=True))
        return parts

    def _wait(self, work: Any) -> None:
        """Until a message has arrived. Raises LostRankError."""
        try:
            while not work.is_completed():  # else it is well, though its sender may be gone
                if self.pulse is not None and (why := self.pulse.look()):
                    raise LostRankError(why)
                try:
                    work.wait(SLICE)
                except RuntimeError:  # the slice is over, or the message failed
                    if work.is_completed():
                        raise
            work.wait()
        except RuntimeError as error:
            raise LostRankError("another rank ended, or did not answer in time") from error


ALONE = Ranks()


def launched() -> int:
    """How many ranks torchrun started; 1 without it."""
    if not all(name in os.environ for name in VARIABLES):
        return 1
    return int(os.environ["WORLD_SIZE"])


def variables_of(rank: int, size: int, folder: Path) -> dict[str, str]:
    """Return what a process of this machine needs to be one of `size` ranks, which meet by a file
    in the folder, and send to each other over the loopback interface alone."""
    return {
        "RANK": str(rank),
        "WORLD_SIZE": str(size),
        "LOCAL_WORLD_SIZE": str(size),
        "MASTER_ADDR": "127.0.0.1",
        "MASTER_PORT": "0",
        "GLOO_SOCKET_IFNAME": "lo0" if sys.platform == "darwin" else "lo",
        FILE_VARIABLE: (folder / "ranks").absolute().as_uri(),
    }


def join() -> Ranks:
    """Meet the ranks that torchrun started. `ALONE` without it, or with one rank.

    Raises LostRankError where they do not meet.
    """
    if launched() == 1:
        return ALONE
    from torch import distributed
    from torch.distributed.distributed_c10d import PrefixStore
    from torch.distributed.rendezvous import rendezvous

    try:
        place = os.environ.get(FILE_VARIABLE, "env://")
        rank, size = int(os.environ["RANK"]), launched()
        store, rank, size = next(rendezvous(place, rank, size))
        distributed.init_process_group(
            "gloo", store=PrefixStore("gsedit", store), rank=rank, world_size=size, timeout=TIMEOUT
        )
    except RuntimeError as error:
        raise LostRankError(f"the ranks cannot meet: {error}") from error
    local = int(os.environ.get("LOCAL_WORLD_SIZE", "1"))
    ends = PrefixStore("gsedit-ends", store)
    pulse = Pulse(ends, rank, size)
    pulse.start()
    return Ranks(rank, size, local, ends, pulse)


def _part(count: int, rank: int, size: int) -> slice:
    return slice(-(-count * rank // size), -(-count * (rank + 1) // size))
