"""The package `uvcloth_core`: `uvcloth.player` by another name, so that both can be installed together."""

import sys

from setuptools import setup

sys.path.insert(0, "runtime")
from wheel_commands import commands

setup(packages=["uvcloth_core"], **commands("uvcloth_core"))
