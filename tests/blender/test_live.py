"""A baked character in Blender: live, scrubbed, moved, saved, cached, and refused."""

import shutil
import struct
import subprocess
from pathlib import Path

import numpy as np
import pytest

from tests.blender.conftest import Done
from uvcloth.commands.play import Play
from uvcloth.commands.run.play import play
from uvcloth.motion.options import MotionOptions
from uvcloth.player.baked import open_baked
from uvcloth.player.outfit import Cloth, Outfit

MILLIMETRE = 1e-3
ROUNDED = 1e-5
"""Metres by which Blender's single precision is off, a few metres from its origin."""


def apart(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Distances (F, V), m, of vertices."""
    return np.linalg.norm(first - second, axis=-1)


def test_it_registers_and_goes_without_a_trace(done: Done) -> None:
    assert done.said["registered"]
    assert done.said["unregistered"]


def test_an_environment_is_made_from_a_folder_of_wheels(done: Done) -> None:
    none, no_folder, no_wheel, python = done.said["environments"]
    assert "nothing: is no folder of wheels" in none
    assert "is no folder of wheels" in no_folder
    assert "the environment was not made (No matching distribution found for uvcloth" in no_wheel
    subprocess.run([python, "-c", "import uvcloth"], check=True)


def test_the_command_for_a_terminal_makes_the_python_that_is_named(done: Done) -> None:
    """Run as it is, but for the folder of wheels in place of the package index."""
    python = Path(done.said["will_be"])
    shutil.rmtree(python.parents[1])
    command = f"{done.said['command']} --no-index --find-links '{done.folder / 'wheels'}'"
    subprocess.run(command, shell=True, check=True, capture_output=True)
    subprocess.run([python, "-c", "import uvcloth"], check=True)


def test_the_scene_gets_the_frames_of_the_file(done: Done, baked: Path) -> None:
    motion = open_baked(baked).motion()
    assert done.said["frames"] == [round(motion.fps), 0, len(motion.times) - 1]
    assert done.said["modifiers"] == ["ARMATURE", "NODES"]
    assert done.said["uv"] == 1


def test_bones_are_the_joints_of_the_file(done: Done, baked: Path) -> None:
    expected = open_baked(baked).motion().transforms[: len(done.arrays["joints"])]
    assert np.abs(done.arrays["joints"] - expected).max() < 1e-6


def test_it_shows_what_the_runtime_makes_of_these_joints(done: Done, baked: Path) -> None:
    file = open_baked(baked)
    cloth = Cloth(Outfit(file.content))
    cloth.start(done.arrays["joints"][0])
    for joints, shown in zip(done.arrays["joints"], done.arrays["played"], strict=True):
        cloth.step(joints, 1.0 / 30.0)
        assert apart(shown, cloth.vertices(0)[done.arrays["source"]]).max() < ROUNDED


@pytest.mark.parametrize("fps", [24, 60])
def test_steps_are_as_long_as_the_frames_of_the_scene(done: Done, baked: Path, fps: int) -> None:
    cloth = Cloth(Outfit(open_baked(baked).content))
    cloth.start(done.arrays[f"joints_{fps}"][0])
    for joints, shown in zip(done.arrays[f"joints_{fps}"], done.arrays[f"at_{fps}"], strict=True):
        cloth.step(joints, 1.0 / fps)
        assert apart(shown, cloth.vertices(0)[done.arrays["source"]]).max() < ROUNDED


def test_it_is_what_play_writes(done: Done, baked: Path, tmp_path: Path) -> None:
    """But for single precision: joints 1e-8 m off give other folds at a few vertices, 1.4 mm at most."""
    options = MotionOptions(frames="0:10")
    play(Play(file=baked, out=tmp_path / "played.npz", options=options))
    with np.load(tmp_path / "played.npz") as written:
        expected = written["dress_vertices"][:, done.arrays["source"]]
    errors = apart(done.arrays["played"], expected)
    print(f"mean {1e3 * errors.mean():.3f} mm, largest {1e3 * errors.max():.3f} mm")
    assert errors.mean(axis=1).max() < 0.1 * MILLIMETRE
    assert np.quantile(errors, 0.99) < 0.5 * MILLIMETRE


def test_scrubbing_back_gives_the_same_bits(done: Done) -> None:
    assert (done.arrays["scrubbed"] == done.arrays["played"][[3, 0, 9, 5]]).all()


def test_a_render_gets_what_was_played(done: Done) -> None:
    assert apart(done.arrays["rendered"], done.arrays["played"][[4, 5, 6]]).max() < ROUNDED


def test_cloth_is_between_its_frames_where_motion_blur_asks(done: Done) -> None:
    first, last = done.arrays["played"][5], done.arrays["played"][6]
    assert (done.arrays["after_between"] == done.arrays["played"][[5, 6]]).all()
    off = apart(done.arrays["between"], (first + last) / 2.0)
    assert off.mean() < 0.2 * apart(first, last).mean()


def test_the_unit_of_the_scene_moves_no_cloth(done: Done) -> None:
    assert (done.arrays["in_centimetres"] == done.arrays["played"]).all()


def test_undo_takes_back_and_the_cloth_goes_on(done: Done) -> None:
    assert done.said["undone"] == [0.0, 0.0, 0.0]
    assert (done.arrays["undone"] == done.arrays["played"]).all()


def test_cloth_follows_an_armature_that_is_moved_turned_and_scaled(done: Done) -> None:
    place = done.arrays["place"]
    expected = done.arrays["played"] @ place[:3, :3].T + place[:3, 3]
    errors = apart(done.arrays["moved"], expected) / 2.0  # The scale.
    assert errors.mean(axis=1).max() < 0.1 * MILLIMETRE


def test_a_saved_scene_plays_the_same(done: Done) -> None:
    assert (done.arrays["reloaded"] == done.arrays["played"]).all()


def test_a_cache_plays_what_was_live(done: Done) -> None:
    assert not done.said["live"]
    assert done.said["cached_modifiers"] == ["ARMATURE", "MESH_CACHE"]
    assert apart(done.arrays["cached"], done.arrays["played"]).max() < ROUNDED
    assert done.said["mesh_kept"]
    assert done.said["dropped_modifiers"] == ["ARMATURE"]


def test_a_cache_that_is_stopped_or_does_not_fit_leaves_nothing_and_the_cloth_live(done: Done) -> None:
    answers, reports, left, is_live = done.said["cache_stopped"]
    assert answers == ["RUNNING_MODAL", "RUNNING_MODAL", "PASS_THROUGH", "RUNNING_MODAL", "CANCELLED"]
    assert (reports, left, is_live) == ([], 0, True)
    if "cache_full" not in done.said:
        pytest.skip("needs a limit for the size of files")
    answers, (report,), left, is_live = done.said["cache_full"]
    assert answers[-1] == "CANCELLED"
    assert "File too large" in report
    assert (left, is_live) == (0, True)


def test_a_cache_of_one_frame_plays_it(done: Done) -> None:
    first, last = done.said["fewest_frames"]
    assert first == last
    assert apart(done.arrays["one_cached"], done.arrays["played"][[5]]).max() < ROUNDED


def test_a_file_without_a_motion_is_live_in_the_frames_of_the_scene(done: Done) -> None:
    assert done.said["still"] == ""
    before, after = done.said["still_frames"]
    assert before == after
    assert done.said["still_live"] == [True, ""]


def test_the_cache_is_one_file_of_all_frames(done: Done) -> None:
    (path,) = (done.folder / "uvcloth_cache").iterdir()
    content = path.read_bytes()
    signature, _, points, _, _, frames = struct.unpack_from("<12siiffi", content)
    assert (signature, points, frames) == (b"POINTCACHE2\0", len(done.arrays["source"]), 10)
    vertices = np.frombuffer(content, "<f4", offset=32).reshape(frames, points, 3)
    assert apart(vertices, done.arrays["played"]).max() < ROUNDED


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("missing", "cannot be read"),
        ("bad_cut", "not a complete glTF file"),
        ("bad_without_cloth", "has no cloth to play"),
        ("bad_older", "is of version 0, this program reads version 1"),
        ("bad_newer", "this program reads version 1"),
        ("bad_frameless", "has no animation"),
        ("bad_nameless", "joints of its cloth have no names"),
        ("bad_misplaced", "has no mesh"),
    ],
)
def test_a_file_that_cannot_be_opened_is_refused_in_a_sentence(done: Done, name: str, words: str) -> None:
    sentence = done.said["refused"][name]
    assert words in sentence
    assert f"{name}.glb" in sentence
    assert "\n" not in sentence


def test_what_is_refused_leaves_the_scene_as_it_was(done: Done) -> None:
    before, after = done.said["left"]
    assert before == after


def test_faults_while_it_is_live_leave_the_cloth_where_it_was(done: Done) -> None:
    assert "negative scale" in done.said["negative"]
    assert "uneven scale" in done.said["uneven"]
    name, sentence = done.said["scaled_bone"]
    assert f"bone {name} is scaled or stretched" in sentence
    name, sentence = done.said["gone_bone"]
    assert f"bone {name} of Armature is gone" in sentence
    assert "baked.glb is of another skeleton than Armature" in done.said["other_skeleton"]
    assert done.said["stayed"]
    assert "save the .blend first" in done.said["unsaved"]
    sentence, is_live = done.said["gone"]
    assert "missing.glb" in sentence
    assert not is_live
