"""The second process computes, fails, ends and starts again."""

from __future__ import annotations

import math
import os
from pathlib import Path

import pytest
import torch
from research.renderer.worker import Worker, WorkerError, peak_memory


def test_another_process_calls_fails_and_comes_back():
    with Worker() as worker:
        assert worker.call(math.hypot, 3.0, 4.0) == 5.0
        assert worker.call(torch.get_num_threads) == torch.get_num_threads()
        with pytest.raises(WorkerError, match=r"^ValueError: .*math domain"):
            worker.call(math.sqrt, -1.0)
        pid = worker.call(os.getpid)
        with pytest.raises(WorkerError, match=r"ended \(SIGABRT\)"):
            worker.call(os.abort)
        assert worker.call(os.getpid) != pid
        if Path("/proc/self/clear_refs").exists():
            count = 16_000_000
            peak = worker.call(peak_memory, torch.ones, count)
            # a page table and what the first allocation of a process brings along
            assert 4 * count <= peak < 4 * count + 8e6
            assert worker.call(peak_memory, torch.ones, 10) < 1e6  # the earlier peak is forgotten
