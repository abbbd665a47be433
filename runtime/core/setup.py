"""The package `uvcloth_core`, which is `uvcloth.player` by another name: both may be installed side by side."""

import sys

from setuptools import setup

sys.path.insert(0, "runtime")
from wheel_commands import commands

setup(packages=["uvcloth_core"], **commands("uvcloth_core"))
