"""Files appear whole, once, and by one process at a time; what a killed one left is removed."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
from pathlib import Path

import pytest

from gsedit.errors import GseditError, UsageError
from gsedit.run.atomic import atomic_path, is_temporary, locked, remove_temporaries

LEFT = """
import os, sys
from gsedit.run.atomic import atomic_path
with atomic_path(sys.argv[1]) as temporary:
    temporary.write_text("half")
    os._exit(9)
"""


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def write(path: Path, text: str, *, overwrite: bool = False) -> None:
    with atomic_path(path, overwrite=overwrite) as temporary:
        temporary.write_text(text)


def test_of_two_that_write_one_file_the_second_is_told(tmp_path):
    path = tmp_path / "a.ply"

    def both() -> None:
        with atomic_path(path) as second:
            second.write_text("second")
            write(path, "first")  # while the second works

    with pytest.raises(UsageError, match=r"a\.ply already exists: add -f"):
        both()
    assert path.read_text() == "first"
    assert names(tmp_path) == ["a.ply"]


def test_a_file_system_without_links_is_written_too(tmp_path, monkeypatch):
    def link(*_):
        raise OSError(errno.EPERM, "no links here")

    monkeypatch.setattr(os, "link", link)
    write(tmp_path / "a", "one")
    with pytest.raises(UsageError, match="already exists"):
        write(tmp_path / "a", "two")
    assert (tmp_path / "a").read_text() == "one"


@pytest.mark.parametrize("target", ["nowhere", "link"])
def test_a_link_that_leads_nowhere_is_replaced_only_if_asked(target, tmp_path):
    link = tmp_path / "link"
    link.symlink_to(target)
    with pytest.raises(UsageError, match="already exists"):
        write(link, "new")
    write(link, "new", overwrite=True)
    assert names(tmp_path) == ["link"]
    assert not link.is_symlink()


@pytest.mark.skipif(os.name == "nt", reason="Windows cannot tell whether a process runs")
def test_what_a_killed_process_left_is_removed_by_the_next(tmp_path):
    path, other = tmp_path / "a**[b].ply", tmp_path / "x.a**[b].ply"
    for each in (path, other):
        command = [sys.executable, "-c", LEFT, str(each)]  # which is killed while it writes
        assert subprocess.run(command, check=False).returncode == 9
    left = names(tmp_path)
    assert len(left) == 2
    assert all(is_temporary(name) for name in left)
    write(path, "whole")
    assert names(tmp_path) == sorted([path.name, next(n for n in left if ".x.a" in n)])
    remove_temporaries(other)
    with atomic_path(other) as temporary:
        temporary.write_text("in use")
        remove_temporaries(other)  # another process that begins
        assert temporary.exists()


@pytest.mark.parametrize("count", [240, 246, 251])
def test_names_as_long_as_a_file_system_takes_are_written(count, tmp_path):
    for name in (f"{'x' * count}.ply", f"{'é' * (count // 2)}.ply"):
        write(tmp_path / name, name)
        assert (tmp_path / name).read_text() == name


@pytest.mark.parametrize(
    ("code", "kind"),
    [(errno.ENOSPC, GseditError), (errno.EIO, GseditError), (errno.EACCES, UsageError)],
)
def test_a_full_disk_is_a_failure_and_no_wrong_request(code, kind, tmp_path):
    def full() -> None:
        with atomic_path(tmp_path / "a.ply") as temporary:
            temporary.write_text("half")
            raise OSError(code, os.strerror(code))

    with pytest.raises(GseditError, match=os.strerror(code)) as raised:
        full()
    assert type(raised.value) is kind
    assert not names(tmp_path)


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such locks")
def test_one_process_works_on_an_output(tmp_path):
    path = tmp_path / "new" / "out.safetensors"
    code = (
        "from gsedit.run.atomic import locked; from pathlib import Path; "
        f"held = locked(Path({str(path)!r})); held.__enter__()"
    )
    with locked(path):
        second = subprocess.run([sys.executable, "-c", code], capture_output=True, check=False)
        assert b"another gsedit is writing" in second.stderr
    assert not path.parent.exists()
    killed = subprocess.run([sys.executable, "-c", f"{code}; import os; os._exit(9)"], check=False)
    assert killed.returncode == 9
    with locked(path):  # the lock ended with the process
        assert [is_temporary(name) for name in names(path.parent)] == [True]
    assert not names(path.parent)
