"""Build backend: setuptools, which asks for a compiler from the package index where the system has none."""

from typing import Any

from compile import requirements
from setuptools import build_meta
from setuptools.build_meta import *  # noqa: F403


def get_requires_for_build_wheel(config_settings: Any = None) -> list[str]:
    """Packages that a wheel needs to be built."""
    return [*build_meta.get_requires_for_build_wheel(config_settings), *requirements()]


def get_requires_for_build_editable(config_settings: Any = None) -> list[str]:
    """Packages that an editable installation needs to be built."""
    return [*build_meta.get_requires_for_build_editable(config_settings), *requirements()]
