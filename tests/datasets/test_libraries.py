"""Settings and handlers that loading a library leaves behind."""

import subprocess
import sys

CODE = """
import os, signal, time
def end(*_):
    print("kept", flush=True)
    raise SystemExit(3)
signal.signal(signal.SIGTERM, end)
from gsedit.views.undistort import import_pycolmap
import_pycolmap().Camera
os.kill(os.getpid(), signal.SIGTERM)
time.sleep(5)
"""


def test_a_program_that_reads_colmap_can_still_end_its_own_way():
    done = subprocess.run([sys.executable, "-c", CODE], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (3, "kept\n", "")
