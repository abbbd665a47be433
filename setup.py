"""The packages of the wheel, and its compiled runtime.

`train` and `evaluate` lie beside `uvcloth` here, and inside it once installed. At the top level of an
installation their names would collide with packages of others.
"""

import sys

from setuptools import find_packages, setup

sys.path.insert(0, "runtime")
from wheel_commands import commands

INSIDE = ("train", "evaluate")

setup(
    packages=[
        *find_packages(include=["rasterize", "rasterize.*", "uvcloth", "uvcloth.*"]),
        *(f"uvcloth.{name}" for top in INSIDE for name in find_packages(include=[top, f"{top}.*"])),
    ],
    package_dir={f"uvcloth.{top}": top for top in INSIDE},
    **commands("uvcloth/player"),
)
