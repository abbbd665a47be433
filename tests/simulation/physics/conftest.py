"""The engines that may make data, each as it makes them."""

import os
from collections.abc import Callable

import pytest

from uvcloth.simulation.blender import PYTHON_VARIABLE
from uvcloth.simulation.engine import Engine
from uvcloth.simulation.engines import ENGINES


@pytest.fixture(params=sorted(ENGINES))
def engine(request: pytest.FixtureRequest) -> Engine:
    """Every engine in turn; a test says by `@cannot(...)` what one of them cannot do, and why."""
    if request.param != "explicit":
        request.getfixturevalue("engines_of_others")
    if request.param == "blender" and not os.environ.get(PYTHON_VARIABLE):
        pytest.skip(f"needs {PYTHON_VARIABLE}, a Python that has the package bpy")
    for mark in request.node.iter_markers("cannot"):
        if mark.args[0] == request.param:
            request.applymarker(pytest.mark.xfail(reason=mark.args[1], strict=True))
    made: Callable[[], Engine] = ENGINES[request.param]
    return made()
