"""What many tests share: the default body, and motion capture where it is at hand."""

import gc
import os
import signal
from collections.abc import Iterator
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from uvcloth.bodies.body import Body

BESIDE_TORCH = (
    "sympy",
    "scipy.stats",
    "scipy.signal",
    "networkx",
    "pyvista",
    "distributed",
    "sklearn.manifold",
)
"""Modules whose compilation takes as long, together, as that of PyTorch."""


def pytest_configure() -> None:
    """Begin with other modules in the second of two processes than in the first, which begins with PyTorch.

    Both import all of them: in a fresh environment each is then compiled once, not by both at the same time.
    """
    if os.environ.get("PYTEST_XDIST_WORKER") == "gw1":
        for name in BESIDE_TORCH:
            with suppress(ImportError):
                import_module(name)


LONG = (
    "tests/test_first_hour.py",
    "tests/test_toy_method.py",
    "tests/test_api.py",
    "tests/methods/",
    "tests/evaluate/",
)
"""Files that take longest: they come first, or one process would run the last of them while others wait."""


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out what is marked as thorough without --thorough; put the tests of LONG first."""
    if not config.getoption("thorough"):
        left_out = [item for item in items if item.get_closest_marker("thorough")]
        config.hook.pytest_deselected(items=left_out)
        items[:] = [item for item in items if item not in left_out]
    items.sort(key=lambda item: not item.nodeid.startswith(LONG))


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the option for tests that take minutes."""
    parser.addoption(
        "--thorough", action="store_true", help="test cloth engines of others, and kill commands, too"
    )


@pytest.fixture
def engines_of_others(request: pytest.FixtureRequest) -> None:
    """Skip a test of another engine without --thorough: they serve to compare, and take minutes."""
    if not request.config.getoption("thorough"):
        pytest.skip("an engine of others: --thorough")


@pytest.fixture
def coarse_pixels(monkeypatch: pytest.MonkeyPatch) -> None:
    """Draw the pictures in which faults are counted with a fifteenth of the pixels, one of a window."""
    monkeypatch.setattr("evaluate.pixels.PIXEL", 0.03)
    monkeypatch.setattr("evaluate.pixels.VIEWED_FRAMES", 1)


@pytest.fixture(autouse=True)
def seeded() -> None:
    """The same random numbers in a test, whichever process it runs in and whatever ran there before."""
    import torch

    torch.manual_seed(0)


@pytest.fixture(scope="session", autouse=True)
def imports_are_no_garbage() -> Iterator[None]:
    """Searches for garbage leave out what imports have made, with which they take half a second."""
    gc.collect()
    gc.freeze()
    yield
    gc.unfreeze()


@pytest.fixture(scope="session", autouse=True)
def interruptible() -> None:
    """Ctrl-C raises KeyboardInterrupt, also where a shell started the tests in the background without it."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session")
def mocap_folder() -> Path:
    """A folder with index_v2.csv and its clips: UVCLOTH_MOCAP, or ../shared/mocap beside the checkout."""
    beside = Path(__file__).parents[2] / "shared" / "mocap"
    folder = Path(os.environ.get("UVCLOTH_MOCAP", beside))
    if not (folder / "index_v2.csv").is_file():
        pytest.skip(f"no motion capture in {folder} (set UVCLOTH_MOCAP)")
    return folder


@pytest.fixture(scope="session")
def body() -> "Body":
    """The body that ships with the package."""
    from uvcloth.bodies.body import load_body

    return load_body()
