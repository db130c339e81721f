"""Ranks that gsedit starts itself open no port to the network."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from gsedit.run.ranks import variables_of

MEETS = """
import os
from contextlib import suppress
from gsedit.run.ranks import join

here = join()
here.first(None)
own = set()
for each in os.listdir("/proc/self/fd"):
    with suppress(OSError):
        own.add(os.readlink(f"/proc/self/fd/{each}"))
for name in ("tcp", "tcp6"):
    for line in list(open(f"/proc/self/net/{name}"))[1:]:
        _, local, _, state, *_, inode = line.split()[:10]
        if state == "0A" and f"socket:[{inode}]" in own:
            print(local.rpartition(":")[0])
here.leave()
os.sys.stdout.flush()
os._exit(0)
"""
LOOPBACK = {"0100007F", "0" * 24 + "01000000", "0000000000000000FFFF00000100007F"}
"""127.0.0.1 and ::1, as Linux writes them."""


@pytest.mark.skipif(not Path("/proc/self/net/tcp").exists(), reason="Linux lists ports there")
def test_ranks_of_this_machine_listen_on_loopback_only(tmp_path):
    started = [
        subprocess.Popen(
            [sys.executable, "-c", MEETS],
            env={**os.environ, **variables_of(rank, 2, tmp_path)},
            stdout=subprocess.PIPE,
            text=True,
        )
        for rank in range(2)
    ]
    said = [process.communicate(timeout=60)[0] for process in started]
    assert [process.returncode for process in started] == [0, 0]
    assert {line for words in said for line in words.split()} <= LOOPBACK
