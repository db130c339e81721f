"""Build step of wheels that hold compiled kernels; everything else is in pyproject.toml.

    GSEDIT_KERNELS=1 pip wheel . --no-deps -w dist

Without GSEDIT_KERNELS the wheel is for any system, and its C++ files are compiled on first use.
GSEDIT_KERNELS may hold options for the compiler, as in `GSEDIT_KERNELS=-static`.
"""

from __future__ import annotations

import os
import shlex
import sys
from pathlib import Path

from setuptools import Distribution, setup
from setuptools.command.bdist_wheel import bdist_wheel
from setuptools.command.build_py import build_py

ROOT = Path(__file__).parent
ASKED = os.environ.get("GSEDIT_KERNELS", "")


class BuildWithKernels(build_py):
    """Python files, and beside each C++ file its libraries for all levels of vectors."""

    def run(self) -> None:
        super().run()
        if not ASKED or self.editable_mode:
            return
        sys.path.insert(0, str(ROOT))
        from rasterizer.compiled import compile_levels
        from rasterizer.compiler import find_compiler

        options = () if ASKED == "1" else tuple(shlex.split(ASKED))
        built = Path(self.build_lib)
        for source in sorted(built.rglob("*.cpp")):
            compile_levels(find_compiler(), source, source.parent, options)


class WheelOfAnyPython(bdist_wheel):
    """A wheel for this system and every Python: its libraries know nothing of Python."""

    def get_tag(self) -> tuple[str, str, str]:
        return "py3", "none", super().get_tag()[2]


class PlatformDistribution(Distribution):
    """Says that there is something of this system in the wheel."""

    def has_ext_modules(self) -> bool:
        return bool(ASKED)


setup(
    cmdclass={"build_py": BuildWithKernels, "bdist_wheel": WheelOfAnyPython},
    distclass=PlatformDistribution,
)
