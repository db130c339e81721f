"""Build steps: manual pages, and wheels that hold compiled kernels; all else is in pyproject.toml.

    GSEDIT_KERNELS=1 pip wheel . --no-deps -w dist

Without GSEDIT_KERNELS the wheel is for any system, and its C++ files are compiled on first use.
GSEDIT_KERNELS may hold options for the compiler, as in `GSEDIT_KERNELS=-static`.
"""

from __future__ import annotations

import os
import shlex
import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

from setuptools import Distribution, setup  # before distutils, which it brings
from setuptools.command.bdist_wheel import bdist_wheel
from setuptools.command.build_py import build_py

from distutils.command.install_data import install_data  # isort: skip

ROOT = Path(__file__).parent
MANUAL = "share/man/man1"
ASKED = os.environ.get("GSEDIT_KERNELS", "")


class BuildWithKernels(build_py):
    """Python files, and beside each C++ file its libraries for all levels of vectors."""

    def run(self) -> None:
        super().run()
        if not ASKED or self.editable_mode:
            return
        sys.path.insert(0, str(ROOT))
        from rasterizer.compiler import find_compiler
        from rasterizer.shipped import compile_levels

        options = () if ASKED == "1" else tuple(shlex.split(ASKED))
        built = Path(self.build_lib)
        for source in sorted(built.rglob("*.cpp")):
            compile_levels(find_compiler(), source, source.parent, options)


class InstallManual(install_data):
    """Manual pages, made from the help of the commands, which loads typer and no other package."""

    def run(self) -> None:
        name, folder = "gsedit_cli", ROOT / "cli"
        spec = spec_from_file_location(name, folder / "__init__.py")
        sys.modules[name] = module_from_spec(spec)
        sys.path.insert(0, str(ROOT))
        from gsedit_cli.core.manual import manual_pages

        pages = Path(self.install_dir, MANUAL)
        self.mkpath(str(pages))
        for file, text in manual_pages(self.distribution.get_version()).items():
            (pages / file).write_text(text, encoding="ascii")
            self.outfiles.append(str(pages / file))


class WheelOfAnyPython(bdist_wheel):
    """A wheel for this system and every Python: its libraries know nothing of Python."""

    def get_tag(self) -> tuple[str, str, str]:
        return "py3", "none", super().get_tag()[2]


class PlatformDistribution(Distribution):
    """Says that there is something of this system in the wheel, and manual pages in any install."""

    def has_ext_modules(self) -> bool:
        return bool(ASKED)

    def has_data(self) -> bool:  # asked by editable installs alone
        return True


setup(
    cmdclass={
        "build_py": BuildWithKernels,
        "install_data": InstallManual,
        "bdist_wheel": WheelOfAnyPython,
    },
    data_files=[(MANUAL, [])],
    distclass=PlatformDistribution,
)
