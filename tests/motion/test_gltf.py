"""Animation in glTF files: what the exporter writes comes back, and the walk of a foreign character too."""

import json
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from tests.characters.made_up import rewritten, vrm_table
from tests.motion.layouts import ROLES, difference
from uvcloth.bodies.body import Body
from uvcloth.errors import InputError
from uvcloth.geometry.skeleton import local_rotations
from uvcloth.motion.clip import Clip
from uvcloth.motion.gltf import animation_names, read_gltf_motion
from uvcloth.motion.library import load_clip
from uvcloth.motion.options import MotionOptions
from uvcloth.writers.glb import Document
from uvcloth.writers.gltf_scene import add_skeleton, animate_skeleton

MOCAP = Path(os.environ.get("UVCLOTH_MOCAP", Path(__file__).parents[3] / "shared" / "mocap"))
CESIUM_MAN = MOCAP.parent / "characters" / "CesiumMan.glb"
CESIUM_ROLES = {
    "hips": "Skeleton_torso_joint_1", "middle_spine": "Skeleton_torso_joint_2",
    "upper_spine": "torso_joint_3", "head": "Skeleton_neck_joint_2",
} | {
    f"{side}_{part}": f"leg_joint_{side[0].upper()}_{number}"
    for side in ("left", "right")
    for part, number in (("thigh", 1), ("shin", 2), ("foot", 3), ("toes", 5))
} | {
    "left_upper_arm": "Skeleton_arm_joint_L__4_", "left_forearm": "Skeleton_arm_joint_L__3_",
    "left_hand": "Skeleton_arm_joint_L__2_", "right_upper_arm": "Skeleton_arm_joint_R",
    "right_forearm": "Skeleton_arm_joint_R__2_", "right_hand": "Skeleton_arm_joint_R__3_",
}  # fmt: skip


def write_motion(clip: Clip, path: Path) -> None:
    document = Document()
    _, first = add_skeleton(document, clip.skeleton)
    times = np.arange(len(clip), dtype=np.float32) / np.float32(clip.fps)
    animate_skeleton(
        document,
        clip.skeleton,
        first,
        clip.transforms().numpy(),
        document.array(times, "SCALAR", bounds=True),
    )
    document.write(path)


def test_a_motion_that_was_exported_comes_back(tmp_path: Path, body: Body) -> None:
    walk = load_clip("walk", body).window(20, 30)
    write_motion(walk, tmp_path / "walk.glb")
    clip = read_gltf_motion(tmp_path / "walk.glb")
    assert (clip.fps, len(clip), clip.skeleton.names) == (30.0, 30, walk.skeleton.names)
    y_up = torch.tensor([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
    expected = walk.positions().double() @ y_up.T.double()
    torch.testing.assert_close(clip.positions(), expected, atol=1e-5, rtol=0)
    torch.testing.assert_close(clip.rotations, y_up @ walk.rotations @ y_up.T, atol=1e-5, rtol=0)
    gap = difference(load_clip(tmp_path / "walk.glb", body), walk, dict.fromkeys(ROLES.values(), ""))
    assert gap.degrees < 6.0, gap
    assert gap.centimetres < 1.0, gap


def test_an_animation_is_chosen_by_its_name_or_number(tmp_path: Path, body: Body) -> None:
    path = tmp_path / "two.glb"
    write_motion(load_clip("walk", body).window(20, 30), path)

    def add_second(written: dict[str, Any]) -> None:
        (walk,) = written["animations"]
        hips = next(index for index, node in enumerate(written["nodes"]) if node.get("name") == "Hips")
        still = [channel for channel in walk["channels"] if channel["target"]["node"] == hips]
        written["animations"] = [walk | {"name": "Walk"}, walk | {"name": "Glide", "channels": still}]
        written["animations"].insert(0, walk | {"name": "Camera", "channels": []})

    rewritten(path, add_second)
    assert animation_names(path) == ["Walk", "Glide"]
    walk, glide = (load_clip(path, body, MotionOptions(animation=name)) for name in ("Walk", "2"))
    assert torch.equal(walk.rotations, load_clip(path, body).rotations)
    knee = body.skeleton.names.index("LeftLeg")
    bends = [local_rotations(body.skeleton.parents, clip.rotations)[:, knee] for clip in (walk, glide)]
    assert float((bends[0] - bends[0][:1]).abs().max()) > 0.3
    assert float((bends[1] - bends[1][:1]).abs().max()) < 1e-5
    with pytest.raises(InputError, match=r"two\.glb: --animation Run: expected one of 1 Walk, 2 Glide"):
        load_clip(path, body, MotionOptions(animation="Run"))
    with pytest.raises(InputError, match=r"walk: --animation is for \.glb, .*this file holds one motion"):
        load_clip("walk", body, MotionOptions(animation="Run"))


def test_an_animation_that_moves_nothing_is_not_the_first(tmp_path: Path, body: Body) -> None:
    """Mixamo's files have one before theirs, "Take 001", that holds the T pose."""
    path = tmp_path / "two.glb"
    walk = load_clip("walk", body).window(20, 30)
    write_motion(walk, path)

    def add_still(written: dict[str, Any]) -> None:
        (moving,) = written["animations"]
        written["accessors"].append({"count": len(walk), "type": "VEC3", "componentType": 5126})
        sampler = moving["samplers"][0] | {"output": len(written["accessors"]) - 1}
        channel = {"sampler": 0, "target": {"node": 0, "path": "translation"}}
        still = {"name": "Take 001", "samplers": [sampler], "channels": [channel]}
        written["animations"] = [still, moving | {"name": "walk"}]

    rewritten(path, add_still)
    assert animation_names(path) == ["Take 001", "walk"]
    moved, still = (read_gltf_motion(path, wanted) for wanted in (None, "Take 001"))
    assert torch.equal(moved.rotations, read_gltf_motion(path, "walk").rotations)
    assert not torch.equal(moved.rotations, still.rotations)


@pytest.mark.parametrize("table", [False, True])
def test_a_file_of_motion_alone_needs_no_skin(tmp_path: Path, body: Body, table: bool) -> None:
    """Libraries of animations have none; those of VRM say which node is which bone of a person."""
    walk = load_clip("walk", body).window(20, 30)
    names = {name: f"bone {joint}" if table else name for joint, name in enumerate(walk.skeleton.names)}
    write_motion(
        replace(walk, skeleton=replace(walk.skeleton, names=tuple(names.values()))), tmp_path / "a.glb"
    )
    path = (tmp_path / "a.glb").rename(tmp_path / ("a.vrma" if table else "walk.glb"))

    def strip(written: dict[str, Any]) -> None:
        del written["skins"]
        written["nodes"].append({"name": "Light"})
        if table:
            vrm_table("VRMC_vrm_animation", names)(written)

    rewritten(path, strip)
    assert len(animation_names(path)) == 1
    gap = difference(load_clip(path, body), walk, dict.fromkeys(ROLES.values(), ""))
    assert gap.degrees < 6.0, gap
    assert gap.centimetres < 1.0, gap


def test_who_lies_in_a_scene_needs_no_axis(tmp_path: Path, body: Body) -> None:
    """Y is up in a glTF file; in a BVH, who lies may stand along another axis."""
    walk = load_clip("walk", body).window(20, 30)
    down = torch.tensor([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
    write_motion(replace(walk, rotations=down @ walk.rotations), tmp_path / "lie.glb")
    lying = load_clip(tmp_path / "lie.glb", body)
    torch.testing.assert_close(lying.rotations[:, 0], down @ walk.rotations[:, 0], atol=1e-3, rtol=0)


@pytest.mark.parametrize("version", ["VRM", "VRMC_vrm"])
def test_the_table_of_a_vrm_file_says_who_moves(tmp_path: Path, body: Body, version: str) -> None:
    walk = load_clip("walk", body).window(20, 30)
    names = {name: f"bone {joint}" for joint, name in enumerate(walk.skeleton.names)}
    skeleton = replace(walk.skeleton, names=tuple(names.values()))
    write_motion(replace(walk, skeleton=skeleton), tmp_path / "walk.vrm")
    rewritten(tmp_path / "walk.vrm", vrm_table(version, names))
    gap = difference(load_clip(tmp_path / "walk.vrm", body), walk, dict.fromkeys(ROLES.values(), ""))
    assert gap.degrees < 6.0, gap


@pytest.mark.skipif(not CESIUM_MAN.is_file(), reason=f"no {CESIUM_MAN}")
def test_a_character_in_other_axes_with_odd_names_walks(tmp_path: Path, body: Body) -> None:
    (tmp_path / "map.json").write_text(json.dumps(CESIUM_ROLES))
    clip = load_clip(CESIUM_MAN, body, MotionOptions(joints=tmp_path / "map.json"))
    guess = load_clip(CESIUM_MAN, body)
    assert float((guess.positions() - clip.positions()).norm(dim=-1).max()) < 0.05
    raw = read_gltf_motion(CESIUM_MAN)
    feet = [raw.skeleton.names.index(CESIUM_ROLES[f"{side}_foot"]) for side in ("left", "right")]
    own = [clip.skeleton.names.index(f"{side}Foot") for side in ("Left", "Right")]
    apart, apart_on_body = raw.positions()[:, feet], clip.positions()[:, own]
    # Feet swing to and fro together with those of the file, as far as the legs are longer.
    swing = (apart[:, 0] - apart[:, 1]).norm(dim=-1)
    swing_on_body = (apart_on_body[:, 0] - apart_on_body[:, 1]).norm(dim=-1)
    correlation = torch.corrcoef(torch.stack([swing, swing_on_body]))[0, 1]
    assert correlation > 0.99


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"glTF\2\0\0\0\xff\xff\0\0", "not a complete glTF file"),
        (b"{}", "has no asset"),
        (b'{"asset": {"version": "2.0"}}', "has no skin"),
        (b'{"asset": {"version": "2.0"}, "nodes": [{}], "skins": [{"joints": [0]}]}', "has no animation"),
        (
            b'{"asset": {"version": "2.0"}, "nodes": [{}], "skins": [{"joints": [4]}], "animations": [3]}',
            r"skins\[0\]\.joints\[0\] is 4, expected one of the 1 nodes",
        ),
    ],
)
def test_files_without_a_motion_are_refused(tmp_path: Path, content: bytes, sentence: str) -> None:
    path = tmp_path / "none.glb"
    path.write_bytes(content)
    with pytest.raises(InputError, match=rf"none\.glb: .*{sentence}"):
        read_gltf_motion(path)
