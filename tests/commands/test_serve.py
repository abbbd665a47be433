"""`uvcloth serve --stdio`: commands run for another program, which may die at any time."""

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from uvcloth.bodies.body import Body
from uvcloth.characters.body import CharacterBody
from uvcloth.commands.serve import Serve
from uvcloth.errors import InputError
from uvcloth.garments.garment import Garment
from uvcloth.garments.on_character import CharacterFrame
from uvcloth.garments.templates import fit_template
from uvcloth.player.baked import open_baked
from uvcloth.writers.obj import save_obj

MILLIMETRE = 1e-3


class Served:
    """The program, and what is said to it and by it."""

    def __init__(self) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-m", "uvcloth", "serve", "--stdio"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        )
        self.greeting = self.read()

    def read(self) -> dict[str, Any]:
        assert self.process.stdout is not None
        return dict(json.loads(self.process.stdout.readline()))

    def send(self, content: bytes) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write(content + b"\n")
        self.process.stdin.flush()

    def run(self, *words: str | Path) -> tuple[list[str], dict[str, Any]]:
        """Lines that a command prints, and the answer."""
        self.send(json.dumps({"run": [str(word) for word in words]}).encode())
        lines = []
        while "says" in (message := self.read()):
            lines.append(message["says"])
        return lines, message


@pytest.fixture(scope="module")
def served() -> Iterator[Served]:
    """One that runs for all tests."""
    program = Served()
    yield program
    program.process.kill()
    program.process.wait()


def modelled(garment: Garment, fitted: CharacterBody, path: Path, sunk: float = 0.0) -> Path:
    """A garment as an artist has it, in the axes and the pose of the character's file; sunk: m into it."""
    frame = CharacterFrame.of(fitted.rigged)
    points = frame.from_rest(garment)
    if sunk:
        inward = points - points.mean(0)
        inward[:, 2 if float(frame.axes[2, 2].abs()) > 1e-3 else 1] = 0.0
        points = points - sunk / float(
            frame.axes.double().det().abs() ** (1 / 3)
        ) * torch.nn.functional.normalize(inward, dim=1)
    save_obj(replace(garment.mesh, vertices=points), path)
    return path


def test_it_says_what_it_is(served: Served) -> None:
    assert served.greeting["protocol"] == 1
    assert served.greeting["uvcloth"]


@pytest.mark.parametrize(
    "content", [b"", b"{", b"[]", b'{"run": 3}', b'{"run": []}', b'{"run": ["train"]}', b"\xff"]
)
def test_what_is_no_request_is_refused_and_it_goes_on(served: Served, content: bytes) -> None:
    served.send(content)
    assert "expected a line" in served.read()["refused"]


def test_options_and_files_that_are_wrong_are_refused(served: Served, tmp_path: Path) -> None:
    _, answer = served.run("bake", "--nothing")
    assert "bake: its options are not understood" in answer["refused"]
    out = tmp_path / "out.npz"
    _, answer = served.run("rest", "--garment", "no.obj", "--body", "no.glb", "--out", out)
    assert "no.obj: no such file" in answer["refused"]


def test_a_garment_on_a_character_stays_where_it_is(
    served: Served, body: Body, character: Path, fitted: CharacterBody, tmp_path: Path
) -> None:
    """In the file's centimetres and raised arms; the second time, the character is known already."""
    tops = fit_template("tops", fitted.body)
    path = modelled(tops, fitted, tmp_path / "mine.obj")
    words = ("rest", "--garment", path, "--body", character, "--out", tmp_path / "rest.npz")
    began = time.monotonic()
    lines, answer = served.run(*words)
    first = time.monotonic() - began
    assert answer == {"done": True}
    assert lines[-1].startswith("mine: ")
    frame = CharacterFrame.of(fitted.rigged)
    metres = float(frame.axes.double().det().abs() ** (1 / 3))
    with np.load(tmp_path / "rest.npz") as arrays:
        off = metres * np.linalg.norm(arrays["mine.vertices"] - frame.from_rest(tops).numpy(), axis=1)
        assert not arrays["mine.left"].any()
        assert not arrays["mine.beneath"].any()
    print(f"mean {1e3 * off.mean():.2f} mm, largest {1e3 * off.max():.2f} mm")
    assert off.mean() < 2 * MILLIMETRE
    began = time.monotonic()
    assert served.run(*words)[1] == {"done": True}
    print(f"first {first:.1f} s, then {time.monotonic() - began:.1f} s")
    assert time.monotonic() - began < 0.7 * first


def test_vertices_that_start_in_the_body_are_named_and_come_out(
    served: Served, character: Path, fitted: CharacterBody, tmp_path: Path
) -> None:
    path = modelled(fit_template("skirt", fitted.body), fitted, tmp_path / "sunk.obj", sunk=0.02)
    served.run("rest", "--garment", path, "--body", character, "--out", tmp_path / "rest.npz")
    with np.load(tmp_path / "rest.npz") as arrays:
        assert arrays["sunk.inside"].sum() > 50
        assert not arrays["sunk.left"].any()


def test_a_bake_on_the_character_is_what_rest_says(
    served: Served, character: Path, fitted: CharacterBody, tmp_path: Path
) -> None:
    path = modelled(fit_template("skirt", fitted.body), fitted, tmp_path / "mine.obj")
    pins = tmp_path / "pins.txt"
    waist = fit_template("skirt", fitted.body).mesh.vertices[:, 2].topk(200).indices
    pins.write_text("\n".join(map(str, waist.tolist())), encoding="utf-8")
    words = ("bake", "--garment", path, "--body", character, "--on-character", "--quality", "fast")
    _, answer = served.run(*words, "--hold", f"mine:{pins}", "--out", tmp_path / "mine.glb")
    assert answer == {"done": True}
    assert [garment.name for garment in open_baked(tmp_path / "mine.glb").garments] == ["mine"]


def test_it_ends_when_the_other_program_does_in_the_middle(character: Path, tmp_path: Path) -> None:
    program = Served()
    words = [
        "rest",
        "--garment",
        str(character),
        "--body",
        str(character),
        "--out",
        str(tmp_path / "rest.npz"),
    ]
    program.send(json.dumps({"run": words}).encode())
    assert program.process.stdin is not None
    program.process.stdin.close()
    assert program.process.wait(20) == 0
    assert not (tmp_path / "rest.npz").exists()


def test_there_is_one_way_to_serve() -> None:
    with pytest.raises(InputError, match="expected --stdio"):
        Serve().run()
