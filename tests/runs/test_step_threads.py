"""A step takes fewer threads while they wait for processors, and changes nothing else."""

from __future__ import annotations

from itertools import pairwise

import pytest
import torch

from gsedit.run import step_threads
from gsedit.run.step_threads import HOLDS_S, LEAST_WAITING, WINDOW_S, StepThreads

COUNT = 4


class Machine:
    """A clock that a step moves by a window, and the seconds that threads wait meanwhile."""

    def __init__(self) -> None:
        self.now, self.waited, self.others = 0.0, 0.0, 0.0
        """`others`: threads of this process that wait when it takes all of `COUNT`."""
        self.threads = StepThreads(lambda: self.now, lambda: self.waited, COUNT)

    def step(self) -> int:
        """Make one, and return on how many threads."""
        with self.threads.step():
            taken = torch.get_num_threads()
            self.now += WINDOW_S
            self.waited += WINDOW_S * max(0.0, self.others - (COUNT - taken))
        return taken

    def steps(self, count: int) -> list[int]:
        return [self.step() for _ in range(count)]


@pytest.fixture(autouse=True)
def undecided(monkeypatch):
    """Torch took COUNT threads, and no variable says otherwise."""
    for name in step_threads.DECIDED_BY:
        monkeypatch.delenv(name, raising=False)
    before = torch.get_num_threads()
    torch.set_num_threads(COUNT)
    yield
    torch.set_num_threads(before)


def test_alone_a_step_takes_all():
    machine = Machine()
    machine.others = LEAST_WAITING / 2
    assert machine.steps(20) == [COUNT] * 20


@pytest.mark.parametrize(("others", "left"), [(0.4, 3), (1.0, 3), (1.7, 2), (9.0, 1)])
def test_a_thread_fewer_for_each_that_waits(others, left):
    machine = Machine()
    machine.others = others
    assert machine.steps(4)[2:] == [left] * 2


def test_all_are_tried_again_and_taken_once_the_others_have_gone():
    machine = Machine()
    machine.others = 3.0
    taken = machine.steps(400)
    trials = [i for i, each in enumerate(taken) if each == COUNT][2:]
    gaps = [WINDOW_S * (b - a) for a, b in pairwise(trials)]
    assert gaps[0] < gaps[1] <= max(gaps) < HOLDS_S[1] + 3 * WINDOW_S
    assert len(trials) < 20
    machine.others = 0.0
    machine.steps(int(HOLDS_S[1] / WINDOW_S) + 2)
    assert machine.steps(5) == [COUNT] * 5


def test_between_steps_torch_has_all():
    machine = Machine()
    machine.others = 3.0
    for _ in range(5):
        machine.step()
        assert torch.get_num_threads() == COUNT
    with pytest.raises(KeyError), machine.threads.step():
        raise KeyError
    assert torch.get_num_threads() == COUNT


@pytest.mark.parametrize("how", [*step_threads.DECIDED_BY, "set_num_threads"])
def test_the_user_decides(how, monkeypatch):
    if how == "set_num_threads":
        torch.set_num_threads(3)
    else:
        monkeypatch.setenv(how, str(COUNT))
    wanted = torch.get_num_threads()
    machine = Machine()
    machine.others = 3.0
    assert machine.steps(5) == [wanted] * 5
