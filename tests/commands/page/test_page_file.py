"""`uvcloth page`: what is written, and what is refused."""

import re
from pathlib import Path

import pytest

from tests.commands.page.opened import needs_wasm
from uvcloth.commands.bake import Bake
from uvcloth.commands.page import Page
from uvcloth.commands.run import page as page_file
from uvcloth.commands.run.bake import bake
from uvcloth.commands.run.page import write_page
from uvcloth.errors import InputError
from uvcloth.motion.options import MotionOptions


def hosts(text: str) -> set[str]:
    """Addresses of other hosts in a text, but for names of XML."""
    return set(re.findall(r"(?:https?|wss?)://[\w.]+", text)) - {"http://www.w3.org"}


@needs_wasm
def test_a_folder_has_all_that_it_needs(skirt: Path, tmp_path: Path) -> None:
    folder = tmp_path / "site"
    write_page(Page(folder, (skirt,)))
    names = {path.name for path in folder.iterdir()}
    assert {"index.html", "uvcloth.wasm", skirt.name} <= names
    for path in folder.glob("*.js"):
        text = path.read_text(encoding="utf-8")
        assert set(re.findall(r'from ?"\./([\w.]+)"', text)) <= names
        assert hosts(text) == set()
    page = (folder / "index.html").read_text(encoding="utf-8")
    assert hosts(page) == set()
    (policy,) = re.findall(r'http-equiv="Content-Security-Policy" content="([^"]*)"', page)
    assert "script-src 'self' 'wasm-unsafe-eval'" in policy
    assert "unsafe-inline" not in policy
    assert '<option value="a%20skirt%20%26%20more.glb">a skirt &amp; more</option>' in page
    assert sum(path.stat().st_size for path in folder.iterdir()) - skirt.stat().st_size < 1.2e6


@needs_wasm
def test_a_single_file_holds_everything(single: Path, skirt: Path) -> None:
    text = single.read_text(encoding="utf-8")
    assert hosts(text) == set()
    assert not re.search(r'(src|href)="(?!data:)', text)
    assert single.stat().st_size < 1.4 * skirt.stat().st_size + 2e6


@needs_wasm
def test_bad_input_is_one_sentence(skirt: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.glb"
    cut.write_bytes(skirt.read_bytes()[:-100])
    for paths, words in (((cut,), r"cut\.glb"), ((skirt, skirt), "is there twice")):
        with pytest.raises(InputError, match=words):
            write_page(Page(tmp_path / "out", paths))
    assert not (tmp_path / "out").exists()


@needs_wasm
def test_the_fast_quality_has_to_be_of_the_same_garments(
    skirt: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    out = tmp_path_factory.mktemp("out")
    other = out / "other.glb"
    bake(Bake(("tops",), other, motion="walk", quality="fast", options=MotionOptions(frames="20:24")))
    for page, words in (
        (Page(out / "page", (skirt,), fast=(other,)), "other joints or garments"),
        (Page(out / "page", (skirt,), fast=(skirt, skirt)), "one for each"),
        (Page(out / "page", fast=(skirt,)), "name the files"),
    ):
        with pytest.raises(InputError, match=words):
            write_page(page)
    assert not (out / "page").exists()


def test_without_the_module_the_command_says_how_to_get_it(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(page_file, "WASM", tmp_path / "uvcloth.wasm")
    with pytest.raises(InputError, match="`make wasm`"):
        write_page(Page(tmp_path / "out"))
