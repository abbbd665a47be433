"""`uvcloth tryon` from a photograph of our own body to the picture of a garment on it."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.tryon.people import SIZE, openpose, pictured
from uvcloth.bodies.body import load_body
from uvcloth.commands.run.tryon import try_on
from uvcloth.commands.tryon import TryOn
from uvcloth.errors import InputError
from uvcloth.files.image import read_picture, write_png
from uvcloth.motion.library import load_clip
from uvcloth.tryon import fit


@pytest.fixture
def command(tmp_path: Path, monkeypatch) -> TryOn:
    """Of a grey photograph, with a short search."""
    monkeypatch.setattr(fit, "STEPS", 60)
    _, points = pictured(load_clip("walk", load_body()), 30, 0.4, load_body())
    (tmp_path / "photo.json").write_text(json.dumps(openpose(points, missing=("left_ear",))))
    write_png(tmp_path / "photo.png", np.full((SIZE[1], SIZE[0], 3), 128, np.uint8))
    return TryOn(
        photo=tmp_path / "photo.png",
        keypoints=tmp_path / "photo.json",
        garment=("skirt",),
        out=tmp_path / "worn.png",
        model=("lbs_smooth",),
    )


def test_a_garment_is_drawn_on_the_person(command: TryOn, tmp_path: Path) -> None:
    lines = list(try_on(replace(command, fitted=tmp_path / "fitted.png")))
    assert lines[0].startswith(f"{command.keypoints}: 24 keypoints, missed by ")
    assert [line.split(":")[0] for line in lines[1:]] == [str(tmp_path / "fitted.png"), str(command.out)]
    changed = (read_picture(command.out) != 128).any(2)
    _, points = pictured(load_clip("walk", load_body()), 30, 0.4, load_body())
    x, y = points[8].round().int().tolist()  # the middle of the hips
    assert changed[y + 20, x]
    assert not changed[: y - 120].any()
    assert 0.01 < changed.mean() < 0.1


def test_a_photograph_that_is_none_is_refused(command: TryOn) -> None:
    command.photo.write_bytes(b"no picture")
    with pytest.raises(InputError, match=r"photo\.png: cannot be read as a picture"):
        list(try_on(command))
    assert not command.out.exists()


def test_a_damaged_photograph_is_refused(command: TryOn) -> None:
    noise = np.random.default_rng(0).integers(0, 255, (300, 300, 3)).astype(np.uint8)
    write_png(command.photo, noise)
    command.photo.write_bytes(command.photo.read_bytes()[:5000])
    with pytest.raises(InputError, match=r"photo\.png: cannot be read as a picture"):
        list(try_on(command))
