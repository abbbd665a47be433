"""docs/first_hour.md: every command on it runs, and prints what the page says that it prints."""

import re
import shlex
import socket
import sys
import time
from pathlib import Path

import pytest
import torch

from tests.characters.made_up import write_character
from tests.characters.test_characters import pieces, stretched
from tests.motion.families import FAMILIES
from tests.motion.layouts import write_layout
from uvcloth.bodies.body import Body
from uvcloth.cli import main
from uvcloth.commands.run import view as live_view
from uvcloth.garments.cage import QUALITIES
from uvcloth.garments.templates import fit_template
from uvcloth.geometry.mesh import Mesh
from uvcloth.motion.library import load_clip
from uvcloth.view.viewer import Viewer
from uvcloth.writers.obj import save_obj

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "first_hour.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"(?:^ {4}.*\n)+", PAGE, re.MULTILINE)
COMMANDS = [block.strip() for block in BLOCKS if block.strip().startswith("uvcloth ")]

FREE = ("role ", "...", "CMU names", "joints without a role", "skin will show", "no skin shows")
"""Beginnings of lines that the page shortens, or that depend on the file."""


FRAMES = 8
"""Of each motion: what the commands print on the way does not depend on the length."""


def printed_after(command: str) -> list[str]:
    """What the page says that a command prints, line by line."""
    after = PAGE[PAGE.index(f"    {command}\n") + len(command) + 5 :]
    block = re.match(r"\n(?:[^ #!].*\n)*\n?((?: {4}.*\n)+)", after)
    if block is None or block[1].strip().startswith("uvcloth "):
        return []
    return [" ".join(line.split()) for line in block[1].splitlines()]


def worded(line: str) -> str:
    """A line without its figures and the token of the live view."""
    return re.sub(r"\d+(\.\d+)?", "#", re.sub(r"(http://[^/]+/)[\w-]+", r"\1TOKEN", line))


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory, body: Body) -> Path:
    """A folder with what the reader brings: a motion in CMU's names, a garment of a DCC, a character."""
    folder = tmp_path_factory.mktemp("hour")
    write_layout(load_clip("walk", body).window(0, FRAMES), FAMILIES["CMU"], folder / "mine.bvh")
    write_character(folder / "hero.glb", stretched(body), pieces(body))
    shirt = fit_template("shirt", body).mesh
    x, y, z = (100 * (shirt.vertices - body.mesh.vertices.amin(0) * torch.tensor([0, 0, 1]))).unbind(1)
    standing = torch.stack([x, z, -y], dim=1)
    save_obj(Mesh(standing, shirt.faces, shirt.uvs, shirt.face_uvs), folder / "blouse.obj")
    return folder


class Visit(Viewer):
    """A live view at a free port that is left with Ctrl-C once it shows something."""

    def __init__(self, host: str, port: int) -> None:
        with socket.socket() as free:
            free.bind((host, 0))
            port = free.getsockname()[1]
        super().__init__(host, port)

    def run(self) -> None:
        deadline = time.monotonic() + 120
        while self.shown < 0:
            assert time.monotonic() < deadline
            self.tick()
            time.sleep(0.05)
        raise KeyboardInterrupt


def test_the_page_has_commands_and_small_pictures() -> None:
    assert {command.split()[1] for command in COMMANDS} == {"rollout", "motion", "body", "fit", "view"}
    for picture in re.findall(r"\((first_hour/[^)]*)\)", PAGE):
        assert 0 < (ROOT / "docs" / picture).stat().st_size < 150_000


def test_the_commands_of_the_page_run_in_its_order(
    files: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("viser", reason="viser is not installed")
    monkeypatch.chdir(files)
    monkeypatch.setattr(live_view, "Viewer", Visit)
    monkeypatch.setitem(QUALITIES, "default", QUALITIES["fast"])
    for command in COMMANDS:
        # The beginning of a clip, on coarse cages and small pictures, says what a whole one says.
        less = ["--frames", f"0:{FRAMES}"] if "--motion walk" in command else []
        small = ["--size", "120x160"] if "--preview" in command else []
        monkeypatch.setattr(sys, "argv", [*shlex.split(command), *less, *small])
        assert main() == 0, command
        streams = capsys.readouterr()
        printed = [worded(" ".join(line.split())) for line in (streams.out + streams.err).splitlines()]
        for line in printed_after(command):
            assert line.startswith(FREE) or worded(line) in printed, command
        for name in re.findall(r"--out (\S+)", command):
            assert (files / name).stat().st_size > 1000, command
