"""Ranges of options: what is out of them is refused in one sentence, before work begins."""

import math
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import pytest

from tests.fuzz.line_targets import CLIP, LINES, of
from tests.test_cli import HEAVY
from train.__main__ import main as train
from uvcloth import cli
from uvcloth.commands.page import Page
from uvcloth.errors import InputError
from uvcloth.files.options import SHOWN, check_options

WILD = (math.nan, math.inf, -math.inf, -(10**15), 10**15)


def altered(command: Any) -> Iterator[tuple[str, Any]]:
    """Copies of a command, each with one wild number in the place of another, with the name of its field.

    What a dataclass itself refuses is left out.
    """
    for each in fields(command):
        value = getattr(command, each.name)
        if is_dataclass(value):
            for name, inner in altered(value):
                yield name, replace(command, **{each.name: inner})
            continue
        first = value[0] if isinstance(value, tuple) and value else value
        if isinstance(first, bool) or not isinstance(first, int | float):
            continue
        for wild in WILD:
            if isinstance(first, int) and isinstance(wild, float):
                continue
            put = (wild, *value[1:]) if isinstance(value, tuple) else wild
            try:
                yield f"{each.name} {wild}", replace(command, **{each.name: put})
            except InputError:
                continue


@pytest.mark.parametrize("name", LINES)
def test_every_number_of_every_command_has_a_range(name: str) -> None:
    command = of(name)(LINES[name].split())
    accepted = []
    for what, wild in altered(command):
        try:
            check_options(wild)
        except InputError:
            continue
        accepted.append(what)
    assert accepted == []


ROLLOUT = ("rollout", "--motion", "walk", "--garment", "tops")


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("view", "nope.bvh"), "nope.bvh: no such file, nor one of dance, jump"),
        (("view", "--garment", "nope.obj"), "--garment nope.obj: no such file, nor one of tops"),
        (("view", "--model", "nope"), "--model nope: no such folder, nor one of physics"),
        (("view", "--body", "nope.npz"), "--body nope.npz: no such file"),
        (("view", "--data", "nope.npz"), "--data nope.npz: no such file"),
        (("view", "--port", "99999"), "--port 99999: expected 1 to 65535"),
        (("view", "--host", "a b"), "--host a b: expected an address"),
        ((*ROLLOUT, "--out", "x.glb", "--threads", "0"), "--threads 0: expected 1 to 1024"),
        (("data", "nope"), "nope: no such folder"),
        (("maps", "walk.npz", "--out", "x", "--frames", "1.5"), "walk.npz: no such file"),
        (("maps", CLIP, "--out", "x", "--frames", "1.5"), "--frames 1.5: expected FIRST:END:STEP"),
        ((*ROLLOUT, "--out", "x.glb", "--device", "meta"), "--device meta: expected cpu, cuda or cuda:N"),
        ((*ROLLOUT, "--out", "x.glb", "x.glb"), "--out: x.glb is there twice"),
        ((*ROLLOUT, "--out", "x.fbx"), "--out x.fbx: the format .fbx is not supported, use one of .glb"),
        ((*ROLLOUT, "--out", "file/x.glb"), "--out file/x.glb: file: cannot be made a folder (is a file)"),
        ((*ROLLOUT, "--out", "folder.glb"), "--out folder.glb: cannot be written (is a folder)"),
        ((*ROLLOUT, "--out", "x.glb", "--frames", "5"), "--frames 5: expected A:B"),
        (
            (*ROLLOUT, "--out", "x.glb", "--from-body", "folder.glb"),
            "folder.glb: no such file, this is a folder",
        ),
        ((*ROLLOUT, "--out", f"{'x' * 300}.glb"), "xxx.glb: too long, expected at most 255 bytes"),
        ((*ROLLOUT, "--out", "x" * 10_000), "x: too long, expected at most 4000 bytes"),
        (("simulate", "walk", "--out", "x", "--scheduler", "here"), "--scheduler here: expected an address"),
        (("simulate", "walk", "--out", "file"), "--out file: file: cannot be made a folder"),
        (("fit", CLIP, "--scale", "0"), "--scale 0: expected more than 0"),
        (("fit", CLIP, "--shift", "0", "nan", "0"), "--shift nan: expected a finite number"),
    ],
)
def test_what_is_out_of_range_is_refused_in_a_sentence(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, words: tuple[str, ...], sentence: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("file").touch()
    Path("folder.glb").mkdir()
    with pytest.raises(InputError) as error:
        cli.parse(words)
    assert sentence in str(error.value)
    assert len(str(error.value)) < 2 * SHOWN
    assert sorted(path.name for path in Path().iterdir()) == ["file", "folder.glb"]


def test_ranges_include_their_ends() -> None:
    for port in ("1", "65535"):
        assert cli.parse(("view", "--port", port, "--host", "::1"))
    with pytest.raises(InputError):
        cli.parse(("view", "--port", "65536"))
    assert cli.parse(("simulate", "walk", "--out", "x", "--scheduler", "tcp://127.0.0.1:8786"))
    assert cli.parse((*ROLLOUT, "--out", "new/folder/x.GLB", "--device", "cuda:1", "--frames", "-9:"))


def test_a_page_in_one_file_may_be_written_again_and_a_file_is_no_folder(tmp_path: Path) -> None:
    page, folder, other = (tmp_path / name for name in ("page.html", "folder.html", "page.txt"))
    page.touch()
    other.touch()
    folder.mkdir()
    check_options(Page(page))
    check_options(Page(tmp_path))
    for out, match in ((folder, "is a folder"), (other, "is a file")):
        with pytest.raises(InputError, match=match):
            check_options(Page(out))


def test_a_refusal_imports_nothing_heavy() -> None:
    code = (
        "import sys\nfrom uvcloth import cli\nsys.argv = ['uvcloth', 'view', 'nope.bvh']\n"
        f"code = cli.main()\nprint(code, [name for name in {HEAVY} if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert done.stdout == "2 []\n"


@pytest.mark.parametrize(
    ("missing", "words", "sentence"),
    [
        ("dask", ("simulate", "walk", "--out", "x"), "simulating needs dask: install uvcloth[simulate]"),
        ("dask", ("demo", "--out", "x"), "simulating needs dask: install uvcloth[simulate]"),
        ("anny", ("body", "--out", "x.npz", "--age", "1"), "making a body needs Anny: install uvcloth[body]"),
        (
            "anny",
            ("outfits", "--count", "1", "--out", "x"),
            "making a body needs Anny: install uvcloth[body]",
        ),
        ("pyacvd", ("outfits", "--count", "1", "--out", "x"), "tailoring needs the remesher"),
        (
            "onnx",
            ("export", "--model", "pbns", "--out", "x.glb"),
            "needs the package onnx: install uvcloth[export]",
        ),
        (
            "av",
            (*ROLLOUT, "--out", "x.glb", "x.mp4"),
            "--out x.mp4: videos need PyAV: install uvcloth[video]",
        ),
        (
            "alembic3d",
            (*ROLLOUT, "--out", "x.abc"),
            "--out x.abc: writing Alembic needs alembic3d: install uvcloth",
        ),
        ("viser", ("view",), "the live view needs viser: install uvcloth[view]"),
    ],
)
def test_without_an_extra_a_command_names_it_before_it_begins(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    missing: str,
    words: tuple[str, ...],
    sentence: str,
) -> None:
    """That of the report: tests/evaluate/test_compare.py."""
    monkeypatch.chdir(tmp_path)
    for name in [name for name in sys.modules if name.partition(".")[0] in (missing, "uvcloth.view.server")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.delitem(sys.modules, "uvcloth.view.server", raising=False)
    monkeypatch.setitem(sys.modules, missing, None)
    monkeypatch.setattr(sys, "argv", ["uvcloth", *words])
    assert cli.main() == 2
    assert sentence in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_training_without_lightning_names_its_extra(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "lightning_fabric", None)
    words = ["train", "pbns", "--garment", "tops", "--out", str(tmp_path / "x")]
    monkeypatch.setattr(sys, "argv", words)
    with pytest.raises(InputError, match=r"training needs Lightning: install uvcloth\[train\]"):
        train()
    assert list(tmp_path.iterdir()) == []
