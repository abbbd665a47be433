"""A skirt that walks, its page in a folder and in one file, and a browser."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.commands.chromium import Chromium
from tests.commands.served import served
from uvcloth.commands.bake import Bake
from uvcloth.commands.page import Page
from uvcloth.commands.run.bake import bake
from uvcloth.commands.run.page import write_page
from uvcloth.commands.run.page_characters import add_clips
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


QUIET = (
    *("--disable-gpu-compositing", "--disable-background-networking", "--disable-component-update"),
    *("--disable-sync", "--disable-extensions"),
)
"""Flags that leave out what a browser does beside its page."""

UNDRAWN = """for (const name of ["clear", "drawArrays", "drawElements"]) {
  WebGL2RenderingContext.prototype[name] = () => {};
}"""
"""Leave out the pixels: without a graphics card they are most of what a page takes."""


@pytest.fixture(scope="session")
def chromium(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chromium]:
    pytest.importorskip("websockets")
    with Chromium(tmp_path_factory.mktemp("browser"), QUIET) as chromium:
        yield chromium


@pytest.fixture
def drawing_browser(chromium: Chromium) -> Iterator[Chromium]:
    """A browser, which does not go on playing a page while other tests run."""
    yield chromium
    chromium.open("about:blank")


@pytest.fixture
def browser(drawing_browser: Chromium) -> Iterator[Chromium]:
    """The browser, whose pages compute all that they show but do not draw it."""
    added = drawing_browser.call("Page.addScriptToEvaluateOnNewDocument", source=UNDRAWN)
    yield drawing_browser
    drawing_browser.call("Page.removeScriptToEvaluateOnNewDocument", **added)
