"""Animations sampled with NumPy alone: key by key as the format says, and as the laboratory reads them."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from tests.small_gltf import document, write_glb
from uvcloth.bodies.body import Body
from uvcloth.motion.gltf import read_gltf_motion
from uvcloth.motion.library import load_clip
from uvcloth.player.animation import animations_of, frame_times, sampled_worlds
from uvcloth.player.gltf_file import GltfFile, read_glb
from uvcloth.player.nodes import compose
from uvcloth.writers.glb import Document
from uvcloth.writers.gltf_scene import TO_Y_UP, add_skeleton, animate_skeleton

KEYS = np.array([[0.0], [0.5], [1.0]], np.float32)
TIMES = np.array([0.0, 0.1, 0.25, 0.5, 0.8, 1.0, 2.0])


def animated(path: Path, values: np.ndarray, mode: str, target: str) -> tuple[GltfFile, dict[str, Any]]:
    """The small file with one channel, of the joint that is a child."""
    written, content = document()
    for each in (KEYS, values.astype(np.float32)):
        width = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}[each.shape[1]]
        view = {"buffer": 0, "byteOffset": len(content), "byteLength": each.nbytes}
        written["bufferViews"].append(view)
        index = len(written["bufferViews"]) - 1
        written["accessors"].append(
            {"bufferView": index, "componentType": 5126, "count": len(each), "type": width}
        )
        content += each.tobytes()
    written["buffers"][0]["byteLength"] = len(content)
    last = len(written["accessors"]) - 1
    written["animations"] = [
        {
            "samplers": [{"input": last - 1, "output": last, "interpolation": mode}],
            "channels": [{"sampler": 0, "target": {"node": 1, "path": target}}],
        }
    ]
    file = read_glb(write_glb(path, written, content))
    return file, file.entries("animations")[0]


def test_shifts_step_and_go_straight_and_in_splines(tmp_path: Path) -> None:
    values = np.array([[0, 0, 0], [1, 2, 3], [1, 0, 3]], float)
    hips = document()[0]["nodes"][0]["translation"]

    def shifts(written: np.ndarray, mode: str) -> np.ndarray:
        file, animation = animated(tmp_path / "a.glb", written, mode, "translation")
        return sampled_worlds(file, animation, [1], TIMES)[:, 0, :3, 3] - hips

    np.testing.assert_allclose(shifts(values, "STEP"), values[[0, 0, 0, 1, 1, 2, 2]], atol=1e-7)
    straight = np.stack([np.interp(TIMES, KEYS[:, 0], column) for column in values.T], axis=1)
    np.testing.assert_allclose(shifts(values, "LINEAR"), straight, atol=1e-7)
    spline = np.zeros((9, 3))
    spline[1::3], spline[2::3], spline[0::3] = values, 2.0, -1.0
    share = 0.2  # At 0.1 s of 0.5 s: p0 h00 + d m0 h10 + p1 h01 + d m1 h11.
    expected = (share**3 - 2 * share**2 + share) * 0.5 * 2.0 + (share**3 - share**2) * 0.5 * -1.0
    expected = expected + (3 * share**2 - 2 * share**3) * values[1]
    np.testing.assert_allclose(shifts(spline, "CUBICSPLINE")[1], expected, atol=1e-7)


def test_rotations_go_the_shorter_way_at_one_speed(tmp_path: Path) -> None:
    turns = Rotation.from_euler("xyz", [[0, 0, 0], [100, 20, 0], [30, 150, 60]], degrees=True)
    quaternions = turns.as_quat()
    quaternions[1] *= -1.0
    file, animation = animated(tmp_path / "a.glb", quaternions, "LINEAR", "rotation")
    times = TIMES[:-1]
    expected = Slerp(KEYS[:, 0], turns)(times).as_matrix()
    np.testing.assert_allclose(sampled_worlds(file, animation, [1], times)[:, 0, :3, :3], expected, atol=1e-6)


def test_the_world_is_parents_before_children(tmp_path: Path) -> None:
    file, animation = animated(tmp_path / "a.glb", np.ones((3, 3)), "LINEAR", "scale")
    hips, chest = document()[0]["nodes"][:2]
    still, one = np.array([0.0, 0.0, 0.0, 1.0]), np.ones(3)
    above = compose(np.array(hips["translation"]), still, one)
    expected = above @ compose(np.array(chest["translation"]), still, one)
    worlds = sampled_worlds(file, animation, [1, 0], TIMES)
    np.testing.assert_allclose(worlds[3], [expected, above], atol=1e-7)


def test_a_walk_is_what_the_laboratory_reads(tmp_path: Path, body: Body) -> None:
    walk = load_clip("walk", body).window(20, 30)
    written = Document()
    _, first = add_skeleton(written, walk.skeleton)
    times = np.arange(30, dtype=np.float32) / np.float32(30.0)
    time = written.array(times, "SCALAR", bounds=True)
    animate_skeleton(written, walk.skeleton, first, walk.transforms().numpy(), time)
    written.write(tmp_path / "walk.glb")
    clip = read_gltf_motion(tmp_path / "walk.glb")
    file = read_glb(tmp_path / "walk.glb")
    nodes = list(range(first, first + len(walk.skeleton.names)))
    (animation,) = animations_of(file, set(nodes))
    sampled, fps = frame_times(file, animation, len(nodes))
    worlds = sampled_worlds(file, animation, nodes, sampled)
    assert fps == clip.fps
    np.testing.assert_allclose(worlds[:, :, :3, :3], clip.rotations.numpy(), atol=1e-6)
    np.testing.assert_allclose(worlds[:, 0, :3, 3], clip.translation.numpy(), atol=1e-6)
    np.testing.assert_allclose(worlds[..., :3, 3], walk.positions().numpy() @ TO_Y_UP.T, atol=2e-6)


def test_damaged_keys(tmp_path: Path) -> None:
    file, animation = animated(tmp_path / "a.glb", np.ones((2, 3)), "LINEAR", "translation")
    with pytest.raises(ValueError, match=r"a\.glb: a sampler of the animation has 3 keys but 2 values"):
        sampled_worlds(file, animation, [1], TIMES)
    values = np.ones((3, 3))
    values[1, 2] = np.nan
    file, animation = animated(tmp_path / "a.glb", values, "LINEAR", "translation")
    with pytest.raises(ValueError, match=r"a\.glb: accessor \d+ holds a value that is not a finite number"):
        sampled_worlds(file, animation, [1], TIMES)
    file, animation = animated(tmp_path / "a.glb", np.zeros((3, 4)), "LINEAR", "rotation")
    with pytest.raises(ValueError, match=r"a\.glb: a rotation of the animation is 0, 0, 0, 0"):
        sampled_worlds(file, animation, [1], TIMES)
