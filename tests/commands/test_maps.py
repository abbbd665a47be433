"""`uvcloth maps` from a sequence file to EXR maps whose numbers are known."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from tests.rasterize.exr_channels import read_channels
from tests.small_body import small_body
from uvcloth import cli
from uvcloth.bodies.body import Body, save_body
from uvcloth.dataset.clip import clip_of_garment
from uvcloth.dataset.clip_file import save_simulated
from uvcloth.geometry.mesh import vertex_normals

FPS = 30.0


@pytest.fixture
def sequence(body: Body, tmp_path: Path) -> Path:
    """A body in rest pose that speeds up along X, in a suit 1 cm off its skin."""
    steps = torch.arange(6, dtype=torch.float32)
    shift = 0.5 * 2.0 * (steps / FPS) ** 2
    transforms = torch.eye(3, 4).repeat(6, len(body.skeleton.names), 1, 1)
    transforms[:, :, 0, 3] = shift[:, None]
    suit = body.mesh.vertices + 0.01 * vertex_normals(body.mesh.vertices, body.mesh.faces)
    moving = suit + shift[:, None, None] * torch.tensor([1.0, 0.0, 0.0])
    path = tmp_path / "suit.npz"
    metadata = {"garment": "tops", "clip": "push"}
    save_simulated(clip_of_garment(moving, body.mesh.faces, suit, transforms, FPS, 0, metadata), path)
    return path


def run(*arguments: str) -> subprocess.CompletedProcess:
    return subprocess.run(
        [sys.executable, "-m", "uvcloth", "maps", *arguments], capture_output=True, text=True, check=False
    )


def test_maps_hold_the_motion_and_the_offset(sequence: Path, tmp_path: Path) -> None:
    out = tmp_path / "maps"
    done = run(str(sequence), "--out", str(out), "--size", "48", "--frames", "2:6:3")
    assert done.returncode == 0, done.stderr
    assert sorted(path.name for path in out.iterdir()) == [
        "contact_sheet.png",
        "suit_0002.exr",
        "suit_0005.exr",
    ]
    maps = read_channels(out / "suit_0005.exr")
    on_body, on_garment = maps["mask.body"] == 1, maps["mask.garment"] == 1
    # x = t^2: the backward difference over (4, 5) / 30 s is 9 / 30 m/s, the second difference 2 m/s2.
    assert np.allclose(maps["velocity.X"][on_body], 0.3, atol=1e-3)
    assert np.allclose(maps["acceleration.X"][on_body], 2.0, atol=1e-2)
    assert np.abs(maps["velocity.Z"]).max() < 1e-3
    offset = np.sqrt(sum(maps[f"offset.{axis}"] ** 2 for axis in "XYZ"))
    assert on_garment.sum() > 0.9 * on_body.sum()
    assert np.median(offset[on_garment]) == pytest.approx(0.01, abs=5e-4)
    assert (offset[~on_garment] == 0).all()


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["{file}", "--out", "{out}", "--frames", "90:99"], "selects none of the 6 frames"),
        (["{file}", "--out", "{out}", "--frames", "x"], "expected FIRST:END:STEP"),
        (["{folder}/none.npz", "--out", "{out}"], "none.npz: no such file"),
        (["{file}", "--out", "{out}", "--size", "0"], "--size 0: expected 1 to 8192"),
        (["{file}", "--out", "{out}", "--body", "{folder}/box.npz"], "was not simulated on the body box"),
        (
            ["{file}", "--out", "{out}", "--body", "{file}"],
            "(format uvcloth-body-1), found format uvcloth-sequence-3",
        ),
    ],
)
def test_bad_input_is_one_sentence(
    sequence: Path,
    tmp_path: Path,
    arguments: list[str],
    sentence: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    save_body(small_body(), tmp_path / "box.npz")
    places = {"file": str(sequence), "out": str(tmp_path / "maps"), "folder": str(tmp_path)}
    monkeypatch.setattr(sys, "argv", ["uvcloth", "maps", *(each.format(**places) for each in arguments)])
    assert cli.main() == 2
    printed = capsys.readouterr().err
    assert sentence in printed
    assert "Traceback" not in printed
    assert not (tmp_path / "maps").exists()
