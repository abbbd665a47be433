"""A skirt that walks, its page in a folder and in one file, and a browser."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.commands.chromium import Chromium
from tests.commands.served import served
from uvcloth.commands.bake import Bake
from uvcloth.commands.bake_file import bake
from uvcloth.commands.page import Page
from uvcloth.commands.page_characters import add_clips
from uvcloth.commands.page_file import write_page
from uvcloth.motion.options import MotionOptions


@pytest.fixture(scope="session")
def skirt(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A skirt on the body of the package, which walks."""
    path = tmp_path_factory.mktemp("baked") / "a skirt & more.glb"
    bake(Bake(("skirt",), path, motion="walk", quality="fast", options=MotionOptions(frames="20:60")))
    add_clips(path, ("jump",))
    return path


@pytest.fixture(scope="session")
def folder(skirt: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The skirt's page, in a folder below that of a server."""
    out = tmp_path_factory.mktemp("site") / "below"
    write_page(Page(out, (skirt,)))
    return out


@pytest.fixture(scope="session")
def qualities(skirt: Path, folder: Path, tmp_path_factory: pytest.TempPathFactory) -> str:
    """The page of a folder beside the skirt's, which has it in two qualities; its name."""
    fast = tmp_path_factory.mktemp("fast") / "another name.glb"
    fast.write_bytes(skirt.read_bytes())
    write_page(Page(folder / "qualities", (skirt,), fast=(fast,)))
    return "qualities/"


@pytest.fixture(scope="session")
def shirt(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A T-shirt with wrinkles on the body of the package, which walks."""
    path = tmp_path_factory.mktemp("shirt") / "shirt.glb"
    bake(Bake(("tops",), path, motion="walk", wrinkles=True, options=MotionOptions(frames="20:50")))
    return path


@pytest.fixture(scope="session")
def single(skirt: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The skirt's page in one file."""
    out = tmp_path_factory.mktemp("single") / "page.html"
    write_page(Page(out, (skirt,)))
    return out


@pytest.fixture(scope="session")
def address(folder: Path) -> Iterator[str]:
    """The address of the folder's page on a server of this machine."""
    with served(folder.parent) as address:
        yield f"{address}below/"


@pytest.fixture(scope="session")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chromium]:
    pytest.importorskip("websockets")
    with Chromium(tmp_path_factory.mktemp("browser")) as browser:
        yield browser
