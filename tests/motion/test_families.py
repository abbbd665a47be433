"""Motion files of every naming family and rest pose: a known motion, written as one, has to come back."""

from pathlib import Path

import pytest

from tests.motion.families import FAMILIES
from tests.motion.layouts import difference, write_layout
from uvcloth.bodies.body import Body
from uvcloth.motion.clip import Clip
from uvcloth.motion.library import load_clip

ANY_ZERO_POSE_DEGREES = 30.0
"""Of joints whose twist nothing but the motion tells: the mean over a short walk is not the rest pose."""


@pytest.fixture(scope="module")
def walk(body: Body) -> Clip:
    return load_clip("walk", body).window(20, 45)


@pytest.mark.parametrize("family", FAMILIES)
def test_a_motion_comes_back_from_every_family(family: str, walk: Clip, tmp_path: Path, body: Body) -> None:
    layout = FAMILIES[family]
    write_layout(walk, layout, tmp_path / "walk.bvh")
    found = difference(load_clip(tmp_path / "walk.bvh", body), walk, layout.names())
    assert found.degrees < (ANY_ZERO_POSE_DEGREES if layout.zero == "random" else 6.0), found
    assert found.centimetres < 2.5, found
    assert found.path_centimetres < 1.0, found
