"""Commands of setuptools for a distribution with the compiled runtime: they compile it, and name its wheel.

A wheel works with every Python, on this platform or that of UVCLOTH_PLATFORM (TARGETS of compile.py).
"""

import os
from pathlib import Path
from typing import Any

from compile import compile_runtime
from setuptools import Distribution
from setuptools.command.bdist_wheel import bdist_wheel
from setuptools.command.build_py import build_py

PLATFORM = os.environ.get("UVCLOTH_PLATFORM", "")


def commands(folder: str) -> dict[str, Any]:
    """What `setup` needs to compile the runtime into a folder of the sources."""

    class BuildWithRuntime(build_py):
        """Compile the runtime into the package before its files are collected."""

        def run(self) -> None:
            compile_runtime(Path(folder).resolve(), PLATFORM or None)
            super().run()

    return {
        "cmdclass": {"build_py": BuildWithRuntime, "bdist_wheel": PlatformWheel},
        "distclass": PlatformDistribution,
    }


class PlatformWheel(bdist_wheel):
    """A wheel that needs no particular Python, since the runtime does not know of Python."""

    def get_tag(self) -> tuple[str, str, str]:
        """The tag in the wheel's name."""
        return "py3", "none", PLATFORM or super().get_tag()[2]


class PlatformDistribution(Distribution):
    """A distribution with machine code."""

    def has_ext_modules(self) -> bool:
        """Say so: files go where those of one platform go."""
        return True
