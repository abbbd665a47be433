"""`uvcloth motion`: what it prints, draws and refuses."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import OpenImageIO
import pytest

from tests.characters.made_up import rewritten
from tests.motion.families import FAMILIES
from tests.motion.layouts import write_layout
from tests.motion.test_gltf import write_motion
from uvcloth.bodies.body import Body
from uvcloth.commands.motion import DescribeMotion
from uvcloth.commands.run.motion import run
from uvcloth.errors import InputError
from uvcloth.motion.library import load_clip
from uvcloth.motion.options import MotionOptions


def test_a_motion_file_is_described_and_drawn(tmp_path: Path, capsys, body: Body) -> None:
    layout = replace(FAMILIES["LAFAN1"], above=("Scene",))
    write_layout(load_clip("walk", body).window(20, 30), layout, tmp_path / "walk.bvh")
    run(
        DescribeMotion(
            str(tmp_path / "walk.bvh"), tmp_path / "sheet.png", options=MotionOptions(frames="5:25")
        )
    )
    printed = capsys.readouterr().out
    for text in (
        "walk: 30 frames at 30 per second, 1.00 s",
        "MotionBuilder names, 22 joints, 22 of them with a role",
        "joints without a role, which move with their parents: none",
        "roles without a joint: upper_neck, left_fingers, right_fingers",
        "rest pose: the motion; up: +y; a leg of 88.06 cm",
        "20 frames at 30 per second",
    ):
        assert text in printed
    assert any(line.split() == ["left_shin", "LeftLeg"] for line in printed.splitlines())
    sheet = OpenImageIO.ImageBuf(str(tmp_path / "sheet.png")).get_pixels(OpenImageIO.UINT8)
    # Walking, seen from the left, spreads the legs; from the front it does not.
    blue = (sheet[..., 2].astype(int) - sheet[..., 0] > 100)[:, :220].any(0)
    assert blue.any()
    halves = [sheet[: len(sheet) // 2], sheet[len(sheet) // 2 :]]
    spread = [(half[..., 0].astype(int) - half[..., 2] > 100)[:, :220].any(0).sum() for half in halves]
    assert spread[1] > spread[0]


def test_the_animations_of_a_file_are_listed(tmp_path: Path, capsys, body: Body) -> None:
    path = tmp_path / "two.glb"
    write_motion(load_clip("walk", body).window(20, 10), path)

    def add_second(written: dict[str, Any]) -> None:
        walk = written["animations"][0]
        written["animations"] = [walk | {"name": "Walk"}, walk | {"name": ""}]

    rewritten(path, add_second)
    run(DescribeMotion(str(path), tmp_path / "sheet.png", options=MotionOptions(animation="Walk")))
    assert "animations: 1 Walk, 2 (no name)\n" in capsys.readouterr().out


def test_what_is_known_is_printed_before_a_refusal(tmp_path: Path, capsys, body: Body) -> None:
    layout = FAMILIES["MotionBuilder"]
    odd = replace(layout, sides=layout.sides.replace("{S}Leg", "{S}Wheel"), zero="along_x")
    path = tmp_path / "walk.bvh"
    write_layout(load_clip("walk", body).window(20, 10), odd, path)
    with pytest.raises(InputError, match=r"no joint is the left shin, right shin; name them with --joints"):
        run(DescribeMotion(str(path), tmp_path / "sheet.png", options=MotionOptions()))
    assert "move with their parents: LeftWheel, RightWheel" in capsys.readouterr().out
    assert not (tmp_path / "sheet.png").exists()
    roles = tmp_path / "map.json"
    roles.write_text(json.dumps({"left_shin": "LeftWheel", "right_shin": "RightWheel"}))
    run(DescribeMotion(str(path), tmp_path / "sheet.png", options=MotionOptions(joints=roles)))
    assert (tmp_path / "sheet.png").exists()
